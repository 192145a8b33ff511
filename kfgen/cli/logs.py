"""Commands on logs: identify, calibrate, simulate, run, denoise, demo, open."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer

from kfgen.cli import options as opt
from kfgen.cli.app import app

TURN = typer.Option(help="The angle of each turn of a gyro, or multiples of it.")
TURN_SD = typer.Option(help="Its standard deviation.")
FIELD = typer.Option(help="The strength of the field, '48 uT'; one axis measures it when left out.")
SENSORS = typer.Option(help="Of accel, mag and gyro, separated by commas; all of the log when left out.")

ADAPTIVE = typer.Option(help="Adapt P, Q or R by this rule of 'kfgen denoise --filter'.")
TUNE = typer.Option("--tune", help="Estimate the filter's noise from its innovations; -o writes the filter.")
SMOOTH = typer.Option("--smooth", help="Estimates with all readings of the log known, later ones as well.")

LOGS_HELP = "Logs of one sensor at rest, fitted together; or an Allan curve with a column tau."
AT_REST = typer.Argument(metavar="LOG...", help=LOGS_HELP)
ONLY = typer.Option(help="Only these, separated by commas; the sensor channels of the log when left out.")
EFFECTS = typer.Option(help="Exactly these, separated by commas; chosen by the data when left out.")
METHOD = typer.Option(
    help="ml (maximum likelihood; the default), kalman (the same, exact at any times), allan (weighted fit of the Allan "
    "curve; the default for a curve), gmwm (wavelet moments), asymptotes (of the Allan plot), arma (equivalent ARMA "
    "model), ekf and em (its state space)."
)
LOG_OUTPUT = typer.Option("-o", "--output", metavar="LOG", help="A .npz or .csv.")
RATES_HELP = "Rate of inputs and log [Hz], 100 where left out; or of a sensor (gnss=5). Repeatable."
RATES = typer.Option(metavar="HZ|SENSOR=HZ", help=RATES_HELP)
DECOY_HELP = "A driver in the log on which nothing depends (temperature). Repeatable."
DECOY = typer.Option(metavar="DRIVER", help=DECOY_HELP)
VIBRATION_HELP = "Vibration that comes and goes on every axis, for example '0.5 m/s^2'."
VIBRATION = typer.Option(metavar="ACCELERATION", help=VIBRATION_HELP)
FLOWN = typer.Option(help="See 'kfgen list', or a manoeuvre file (.toml).")
FILTER = typer.Option(help="The rule of adaptation: kf, iae, iae-q, sage-husa, shafkf-p or shafkf-r.")
RESTING = typer.Option(metavar="LOG", help="Estimate the noise from this log at rest, not from LOG itself.")
ORDER = typer.Option(help="The order p,q of the ARMA process; auto chooses by Akaike's criterion.")
ESTIMATOR = typer.Option(help="The estimator of the process: ml, least-squares, burg, ..., see 'kfgen list'.")
WINDOW = typer.Option(help="The number of innovations that a rule looks at.")
RATIO = typer.Option(help="The ratio of R to Q; the paper has 980.")
PORT = typer.Option(min=0, max=65535, help="The port on this machine; a free one when left out.")
SHOW = typer.Option(help="Open the page in the browser, or only print its address.")
KEPT = typer.Option(metavar="DIR", help="The folder of what is dropped and made.")


@app.command()
def identify(
    logs: Annotated[list[Path], AT_REST],
    rate: opt.Rate = None,
    channels: Annotated[str | None, ONLY] = None,
    effects: Annotated[str | None, EFFECTS] = None,
    method: Annotated[str | None, METHOD] = None,
    columns: opt.Columns = None,
    topic: opt.Topic = "",
    instance: opt.Instance = None,
    output: opt.Output = None,
    json: opt.Json = None,
    report: opt.Report = None,
) -> None:
    """Identify the noise of a sensor at rest. Every number has its interval; what the log cannot tell is said."""
    from kfgen.identify.identify_log import identify as identified
    from kfgen.log.readers import read_long
    from kfgen.report.identify import identify_answer

    with opt.best_so_far():
        data = [read_long(log, rate=rate, columns=columns, topic=topic, instance=instance) for log in logs]
        found = identified(data, channels=channels, effects=effects, method=method)
        answer = identify_answer(found)
        if output:
            found.save(output)
        opt.deliver(answer, json, report)


@app.command()
def calibrate(
    log: opt.LogPath,
    turn: Annotated[str, TURN] = "360 deg",
    turn_sd: Annotated[str, TURN_SD] = "0.5 deg",
    field: Annotated[str | None, FIELD] = None,
    sensors: Annotated[str | None, SENSORS] = None,
    rate: opt.Rate = None,
    columns: opt.Columns = None,
    output: opt.Output = None,
    json: opt.Json = None,
    report: opt.Report = None,
) -> None:
    """Calibrate by poses, turns and a turned magnetometer. Gives biases, scales, angles and irons."""
    from kfgen.calibrate.calibrate import calibrate
    from kfgen.report.calibrate import calibrate_answer

    data = opt.read(log, rate, columns)
    found = calibrate(data, turn=turn, turn_sd=turn_sd, field=field, sensors=sensors)
    if output:
        found.save(output)
    opt.deliver(calibrate_answer(found), json, report)


@app.command()
def simulate(
    model: opt.ModelName,
    output: Annotated[Path, LOG_OUTPUT],
    duration: Annotated[float, typer.Option(help="Length of the log [s].")] = 60.0,
    rate: Annotated[list[str] | None, RATES] = None,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the random numbers.")] = 0,
    manoeuvre: Annotated[str, FLOWN] = "static",
    noise: opt.Noise = None,
    set_: opt.Set = None,
    sensor: opt.Sensors = None,
    decoy: Annotated[list[str] | None, DECOY] = None,
    vibration: Annotated[str | None, VIBRATION] = None,
    json: opt.Json = None,
    report: opt.Report = None,
) -> None:
    """Simulate a log from a model. Sensors have their own rates, and the truth is beside them."""
    from kfgen.core.units import parse_quantity
    from kfgen.log.readers import write_log
    from kfgen.report.filter import simulate_answer
    from kfgen.simulate.rates import read_rates
    from kfgen.simulate.simulate_log import simulate

    of_log, rates = read_rates(rate or ())
    shaken = parse_quantity(vibration, "m/s^2", where="--vibration") if vibration else 0.0
    built, decoys = opt.model_of(model, noise, set_, sensor), tuple(decoy or ())
    log = simulate(built, manoeuvre, duration, of_log, seed, rates=rates, decoys=decoys, vibration=shaken)
    write_log(log, output)
    opt.deliver(simulate_answer(log, str(output)), json, report)


@app.command()
def run(
    model: opt.ModelName,
    log: opt.LogPath,
    noise: opt.Noise = None,
    adaptive: Annotated[str | None, ADAPTIVE] = None,
    tune: Annotated[bool, TUNE] = False,
    smooth: Annotated[bool, SMOOTH] = False,
    set_: opt.Set = None,
    sensor: opt.Sensors = None,
    rate: opt.Rate = None,
    columns: opt.Columns = None,
    topic: opt.Topic = "",
    instance: opt.Instance = None,
    output: opt.Output = None,
    json: opt.Json = None,
    report: opt.Report = None,
) -> None:
    """Run the emitted filter over a log. Estimates, innovations, NIS; with --tune its noise by these."""
    from kfgen.log.readers import write_log
    from kfgen.report.filter import run_answer
    from kfgen.report.tune import tune_answer
    from kfgen.run.estimates import estimates
    from kfgen.run.run import run

    built, data = opt.model_of(model, noise, set_, sensor), opt.read(log, rate, columns, topic, instance)
    if tune:
        beside = {"--adaptive": adaptive, "--smooth": smooth}
        return opt.deliver(tune_answer(built, data, output, beside), json, report)
    found = run(built, data, adaptive=adaptive, smooth=smooth)
    if output:
        write_log(estimates(found, built), output)
    opt.deliver(run_answer(found), json, report)


@app.command()
def denoise(
    log: opt.LogPath,
    filter: Annotated[str, FILTER] = "shafkf-r",
    at_rest: Annotated[Path | None, RESTING] = None,
    channels: opt.Channels = None,
    order: Annotated[str, ORDER] = "2,1",
    estimator: Annotated[str, ESTIMATOR] = "ml",
    window: Annotated[int, WINDOW] = 15,
    ratio: Annotated[float, RATIO] = 980.0,
    rate: opt.Rate = None,
    columns: opt.Columns = None,
    output: opt.Output = None,
    json: opt.Json = None,
    report: opt.Report = None,
) -> None:
    """Denoise a log by adaptive filters, and say the cost. The rules are those of Narasimhappa 2019."""
    from kfgen.log.readers import write_log
    from kfgen.report.denoise import denoise_answer
    from kfgen.run.adaptive.denoise_log import denoise

    data = opt.read(log, rate, columns)
    still = opt.read(at_rest, rate, columns) if at_rest else None
    how = {"order": order, "estimator": estimator, "window": window, "ratio": ratio}
    found = denoise(data, filter, channels, still, **how)  # type: ignore[arg-type]
    if output:
        write_log(found.log, output)
    opt.deliver(denoise_answer(found), json, report)


@app.command()
def demo(
    out: Annotated[Path, typer.Option(metavar="DIR", help="The folder of the results.")] = Path("kfgen-demo"),
    json: opt.Json = None,
) -> None:
    """Run the whole chain on a simulated sensor. It has a hidden effect; the end is a report."""
    from kfgen.demo import run_demo

    answer = run_demo(out, lambda line: print(line, file=sys.stderr))
    opt.deliver(answer, json, None)


@app.command("open")
def open_(
    folder: Annotated[Path, KEPT] = Path("kfgen-open"),
    port: Annotated[int, PORT] = 0,
    browser: Annotated[bool, SHOW] = True,
) -> None:
    """Open a page on this machine for all of this. Drop a log, press identify, gap or audit, take the files home."""
    from kfgen.local_page.local_page import open_page

    open_page(folder, port, lambda address: print(f"{address}\nCtrl-C ends it.", flush=True), browser)
