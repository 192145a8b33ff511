"""What ``--help`` shows: commands and options in groups, and examples to type."""

from __future__ import annotations

import shlex
from collections.abc import Mapping
from typing import Any

COMMAND_GROUPS: Mapping[str, tuple[str, ...]] = {
    "Start here": ("demo", "open", "list"),
    "Noise of a sensor": ("identify", "calibrate", "plan", "convert", "denoise", "fleet"),
    "Filter": ("derive", "audit", "emit", "verify"),
    "Model against log": ("simulate", "run", "gap", "judge"),
}
"""Every command, by what it is about."""
EXAMPLES: Mapping[str, tuple[tuple[str, str], ...]] = {
    "kfgen": (
        ("See what is inside a log", "kfgen list flight.ulg"),
        (
            "Noise of a sensor at rest, with its Allan plot",
            "kfgen identify rest.bag -o noise.toml --report noise.html",
        ),
        ("The same for Kalibr", "kfgen convert noise.toml --to kalibr -o imu.yaml"),
        ("What a model is missing", "kfgen gap flight.ulg --model ins15 --report gap.html"),
    ),
    "demo": (("The whole chain on a simulated gyro", "kfgen demo --out out"),),
    "open": (("A page in the browser", "kfgen open"),),
    "list": (
        ("Models, sensors, effects, formats", "kfgen list"),
        ("Topics, channels, rates and gaps of a log", "kfgen list rest.bag"),
    ),
    "identify": (
        (
            "A noise file, and a page with the Allan plot",
            "kfgen identify rest.csv -o noise.toml --report noise.html",
        ),
        ("One of several sensors of a bag", "kfgen identify rest.bag --topic /imu0 -o noise.toml"),
        (
            "Columns with names and units of their own",
            "kfgen identify log.csv --columns 'gyro_x=gx [deg/s/131]' --rate 100",
        ),
        (
            "Two channels of a folder of EuRoC or TUM-VI",
            "kfgen identify V1_01_easy --channels gyro_x,accel_x",
        ),
    ),
    "calibrate": (
        ("Poses, turns and a turned magnetometer", "kfgen calibrate log.csv --field '48 uT' -o sensors.toml"),
    ),
    "plan": (
        ("How long to log for 10 % on each number", "kfgen plan noise.toml --rate 100 --wanted 0.1"),
        (
            "Which manoeuvre distinguishes two effects",
            "kfgen plan --between time_delay@gnss,lever_arm@gnss --model ins15",
        ),
    ),
    "judge": (
        (
            "Whether an effect of your own explains a log",
            "kfgen judge supply_squared.py log.csv --model noise.toml",
        ),
    ),
    "convert": (
        ("Kalibr's imu.yaml", "kfgen convert noise.toml --to kalibr -o imu.yaml"),
        ("Parameters of PX4", "kfgen convert noise.toml --to px4 --rate 200 -o noise.params"),
        ("Every number in every usual unit", "kfgen convert noise.toml --to table"),
    ),
    "denoise": (
        ("An adaptive filter, and what it costs", "kfgen denoise log.csv --filter shafkf-r -o denoised.csv"),
    ),
    "fleet": (("One log of each sensor", "kfgen fleet 'logs/*.csv' -o typical.toml --report fleet.html"),),
    "derive": (("F, G, H, Phi and Qd as LaTeX", "kfgen derive ins15 --format latex"),),
    "audit": (
        ("At rest, and in a manoeuvre", "kfgen audit ins15 --manoeuvre static --manoeuvre figure-8"),
        ("How well the states show in a log", "kfgen audit ins15 --log flight.ulg"),
    ),
    "emit": (
        ("One C header with its self-test", "kfgen emit ahrs6 --target c --noise noise.toml -o filter"),
        ("Counted on a Cortex-M4F", "kfgen emit ahrs6 --target c --core m4f -o filter"),
    ),
    "verify": (
        ("Host and an emulated Cortex-M4F", "kfgen verify filter --core host --core m4f"),
        ("Simulated faults", "kfgen verify filter --faults"),
    ),
    "simulate": (
        (
            "Ten minutes in flight",
            "kfgen simulate ins15 --manoeuvre figure-8 --duration 600 --rate gnss=5 -o log.npz",
        ),
    ),
    "run": (
        ("Estimates of a filter over a log", "kfgen run ins15 flight.ulg -o estimates.npz"),
        ("Its noise by its innovations", "kfgen run quad.toml flight.ulg --tune -o tuned.toml"),
    ),
    "gap": (
        (
            "A sensor at rest against its noise file",
            "kfgen gap field.csv --model noise.toml -o improved.toml",
        ),
        ("A filter in flight, for a script", "kfgen gap flight.ulg --model quad.toml --fail-on-gap"),
    ),
}
"""Of each command what is done, and what is typed; ``kfgen`` alone stands for all of them."""


class GroupHelp:
    """A group of commands whose help lists them by what they are about."""

    commands: Any

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        """Write the commands, and examples; `formatter` knows the width of the terminal."""
        width = max(map(len, self.commands))
        for title, names in COMMAND_GROUPS.items():
            own = {n: self.commands[n] for n in names}
            with formatter.section(title):
                room = formatter.width - 6 - width
                formatter.write_dl([(f"{n:{width}}", c.get_short_help_str(room)) for n, c in own.items()])
        write_examples("kfgen", formatter)


class CommandHelp:
    """A command whose help has its own options separate from those that it shares with others."""

    name: str | None
    get_params: Any

    def format_options(self, ctx: Any, formatter: Any) -> None:
        """Write arguments and options, and examples; `formatter` knows the width of the terminal."""
        groups: dict[str, list[tuple[str, str]]] = {"Arguments": [], "Options": []}
        for parameter in self.get_params(ctx):
            record = parameter.get_help_record(ctx)
            is_argument = parameter.param_type_name == "argument"
            title = "Arguments" if is_argument else parameter.rich_help_panel or "Options"
            groups.setdefault(title, []).extend([record] if record else [])
        for title, records in groups.items():
            if records:
                with formatter.section(title):
                    formatter.write_dl(records)
        write_examples(str(self.name), formatter)


def write_examples(command: str, formatter: Any) -> None:
    """Write the examples of a command; lines that are longer than the terminal go on after a backslash.

    Parameters
    ----------
    command : str
        A key of `EXAMPLES`.
    formatter : help formatter
        Of the library of the command line.
    """
    with formatter.section("Examples"):
        for done, typed in EXAMPLES[command]:
            formatter.write_text(f"{done}:")
            for line in wrapped(typed, formatter.width - 4):
                formatter.write(f"    {line}\n")


def wrapped(command: str, width: int) -> list[str]:
    """A command line in lines of a width, each but the last with a backslash at its end.

    Parameters
    ----------
    command : str
    width : int
        Letters of a line; a longer word has a line of its own.

    Returns
    -------
    list of str
    """
    lines = [""]
    for word in map(shlex.quote, shlex.split(command)):
        longer = f"{lines[-1]} {word}".lstrip(" ") if len(lines) == 1 else f"{lines[-1]} {word}"
        if lines[-1].strip() and len(longer) > width - 2:
            lines[-1] += " \\"
            lines.append(f"  {word}")
        else:
            lines[-1] = longer
    return lines
