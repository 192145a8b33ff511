"""Parameters of autopilots that hold what a filter file found, and how a file of them is made."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import ModuleType

from kfgen.consumers.autopilots.settable_values import SettableValue, SettableValues
from kfgen.consumers.autopilots.steps import lines, outside, stepped
from kfgen.consumers.base import Converted, Imu, Value
from kfgen.core.channel_names import AXES
from kfgen.core.units import from_si

VALUE_THAT_FLEW = "; beside the value that flew"
"""What ends the words of a setting that corrects samples which are corrected already."""


@dataclass(frozen=True)
class Setting:
    """A parameter of an autopilot.

    Parameters
    ----------
    of : tuple of str
        Names of findings, the largest of which it holds.
    unit : str
    low, high : float
        The range that the autopilot documents, in `unit`.
    sign : float
        Multiplies the finding.
    base : float
        The value without any finding, in `unit`: 1 of a scale.
    said : str
        What is to be known of it.
    needs : mapping of str to float
        Other parameters without which it does nothing.
    """

    of: tuple[str, ...]
    unit: str
    low: float
    high: float
    sign: float = 1.0
    base: float = 0.0
    said: str = ""
    needs: Mapping[str, float] | None = None

    def value(self, found: Sequence[SettableValue]) -> Value:
        """Its number in its own unit."""
        most = max(found, key=lambda f: abs(f.value))
        words = most.words + (f", the largest of {len(found)}" if len(found) > 1 else "")
        number = self.base + self.sign * from_si(most.value, self.unit)
        return Value((number + 0.0,), self.unit, f"{words}{'; ' + self.said if self.said else ''}")


def on_axes(name: str, of: str, setting: Setting) -> dict[str, Setting]:
    """A setting for each axis.

    Parameters
    ----------
    name : str
        With ``{axis}``: ``EKF2_GPS_POS_{axis}``.
    of : str
        The finding without its axis: ``gnss.arm``.
    setting : Setting
        What they share; its `of` is not used.

    Returns
    -------
    dict of str to Setting
    """
    shared = {k: v for k, v in vars(setting).items() if k != "of"}
    return {name.format(axis=a.upper()): Setting((f"{of}.{a}",), **shared) for a in AXES}


def iron_settings(diagonal: str, symmetric: str, lo: float, hi: float) -> dict[str, Setting]:
    """The six entries of a compass' soft iron.

    Parameters
    ----------
    diagonal, symmetric : str
        With ``{of}``, which is X, Y, Z; and X, Y, Z for the entries xy, xz, yz.
    lo, hi : float
        Range of the diagonal.

    Returns
    -------
    dict of str to Setting
    """
    said = VALUE_THAT_FLEW[2:]
    found = {
        diagonal.format(of=a.upper()): Setting((f"mag.distortion.{a}{a}",), "1", lo, hi, base=1.0, said=said)
        for a in AXES
    }
    for name, entry in (("X", "xy"), ("Y", "xz"), ("Z", "yz")):
        found[symmetric.format(of=name)] = Setting((f"mag.distortion.{entry}",), "1", -1.0, 1.0, said=said)
    return found


def noise_of(*channels: str) -> tuple[str, ...]:
    """The names of the noise of channels."""
    return tuple(f"{c}.noise" for c in channels)


def autopilot_file(module: ModuleType, imu: Imu, findings: SettableValues | None = None) -> Converted:
    """The parameters of an autopilot.

    Parameters
    ----------
    module : module
        Of the autopilot: ``TITLE``, ``SOURCE``, ``STEPS``, ``SETTINGS``, ``LINE`` and ``DOCUMENTS``.
    imu : Imu
    findings : SettableValues, optional
        Of a filter file; None of a noise file.

    Returns
    -------
    Converted
    """
    inertial = findings is None or any(imu.readings(s) for s in ("gyro", "accel"))
    values = stepped(imu, module.STEPS) if inertial else {}
    said = [*imu.warnings(module.TITLE), *outside(values, module.STEPS, module.DOCUMENTS)] if inertial else []
    if findings is not None:  # which names each effect that nothing holds, of the inertial sensors too
        said = [w for w in said if f"no parameter of {module.TITLE}" not in w]
    text = [*imu.header(module.TITLE, module.SOURCE), *lines(values, module.LINE)]
    if findings is not None:
        more, words = settled(findings, module.SETTINGS, module.DOCUMENTS)
        text += lines(more, module.LINE)
        values, said = values | more, [*said, *words]
    return Converted("\n".join(text), values, tuple(said))


def settled(
    findings: SettableValues, settings: Mapping[str, Setting], documents: str
) -> tuple[dict[str, Value], list[str]]:
    """The values of settings, and what is to be said: ranges, and what no parameter holds.

    Parameters
    ----------
    findings : SettableValues
    settings : mapping of str to Setting
        By the autopilot's names.
    documents : str
        Whose ranges they are.

    Returns
    -------
    values : dict of str to Value
    said : list of str
    """
    values: dict[str, Value] = {}
    said = list(findings.warnings)
    held: set[str] = set()
    for name, setting in settings.items():
        found = [findings.named[key] for key in setting.of if key in findings.named]
        if not found:
            continue
        held.update(key for key in setting.of if key in findings.named)
        value = setting.value(found)
        number = value.numbers[0]
        if not setting.low <= number <= setting.high:
            said.append(
                f"{name} = {number:.4g} {setting.unit} is outside the {setting.low:g} to {setting.high:g} of {documents} "
                "and is not written"
            )
            values[name] = Value((), setting.unit, f"{number:.4g}, outside its range; left out")
            continue
        values[name] = value
        for needed, at in (setting.needs or {}).items():
            values[needed] = Value((at,), "", f"without it {name} does nothing")
    added = [
        name for name in values if settings.get(name) and settings[name].said.endswith(VALUE_THAT_FLEW[2:])
    ]
    if added:
        said.append(
            f"{', '.join(added)}: the samples of a log are calibrated already; add these numbers to the values that flew"
            " (multiply scales)"
        )
    left = [s for key, f in findings.named.items() if key not in held for s in f.source]
    for words in dict.fromkeys((*left, *findings.others)):
        said.append(f"no parameter holds {words}")
    return values, said
