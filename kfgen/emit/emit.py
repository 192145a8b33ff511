"""The verb `emit`: a filter as code, with its self-test, in a folder of its own."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

from kfgen.core.errors import InputError
from kfgen.effects.noise_model import NoiseModel
from kfgen.emit.covariance.factored import Factored
from kfgen.emit.covariance.forms import Packed
from kfgen.emit.folder import EmittedFilter, write_folder
from kfgen.emit.horizon.memory import MARGIN
from kfgen.emit.routines import Program
from kfgen.emit.targets import filterpy
from kfgen.emit.watch.parts import checked
from kfgen.model.build import ModelSource, NoiseSource, filter_of
from kfgen.model.discretise import DiscreteModel
from kfgen.model.known_delays import longest_delay

CostCounter = Callable[[Program], tuple[str, ...]]
"""What the routines of a program cost on a processor, in lines for its header."""


def emit(  # noqa: PLR0913 - the choices of one command
    model: ModelSource,
    folder: str | Path,
    target: str = "c",
    form: str | None = None,
    real: str = "float",
    *,
    noise: NoiseSource | None = None,
    rate: float = 100.0,
    order: int = 1,
    max_step: float | None = None,
    loops: bool = False,
    q_interval: float | None = None,
    horizon: float | None = None,
    without: Sequence[str] = (),
    lanes: bool = False,
    costs: CostCounter | None = None,
    force: bool = False,
) -> EmittedFilter:
    """Write a filter as code, all files or none.

    Parameters
    ----------
    model : FilterModel, str or Path
        A filter of `kfgen.build`, the name of a library model, or the path of a filter file or a model file.
    folder : path-like
        A new folder, an empty one, or one of an emitted filter, which is replaced.
    target : str
        ``c``, ``numpy`` or ``filterpy``; see `kfgen.list_all`.
    form : str, optional
        Of the covariance: ``ud``, its factors, never indefinite, or ``p``, itself; by default ``p`` of ``filterpy`` only.
    real : str
        Type of the numbers: ``float`` or ``double``.
    noise : NoiseModel or path-like, optional
        The effects of the channels; only beside a name or a path.
    rate, max_step : float
        Sampling rate [Hz]; longest step [s], by default a tenth of a second, or what the fastest effect allows.
    order : int
        Order in the step of the motion's coupling, 1 to 3.
    loops, lanes : bool
        Loops in place of repeated columns: less code, more instructions. Hooks for firmware with several filters.
    q_interval : float, optional
        Seconds between two additions of noise to biases that walk (``ud`` only), 0: every step; 1 s where left out.
    horizon : float, optional
        Age to which stamped measurements are fused [s], 0: none; a fifth more than the longest delay where left out.
    without : sequence of str
        Parts of the supervisor to leave out, of `kfgen.emit.watch.parts.PARTS`.
    costs : callable, optional
        Counts what the routines cost, for the header: `kfgen.verify.compare.costs` with its cores chosen.
    force : bool
        Replace also files of the folder that were changed since they were written.

    Returns
    -------
    EmittedFilter

    Raises
    ------
    InputError
        As in `kfgen.build`, an unknown target, form, type or part, or a folder with files of other origin.
    """
    built = filter_of(model, noise)
    form = form or (Packed.NAME if target == filterpy.TARGET else Factored.NAME)
    behind = MARGIN * longest_delay(built) if horizon is None else horizon
    discrete, left = DiscreteModel.at_rate(built, rate, order, max_step), checked(without)
    program = Program(discrete, form, real, loops, q_interval, horizon=behind, without=left, lanes=lanes)
    if costs is not None:
        program = replace(program, costs=_counted(program, target, costs))
    noise_file = built.given if isinstance(built.given, NoiseModel) else None
    names = write_folder(program, target, noise_file, folder, force)
    return EmittedFilter(program, target, Path(folder), tuple(names))


def _counted(program: Program, target: str, costs: CostCounter) -> tuple[str, ...]:
    """What its routines cost; InputError where the target has no instructions of its own."""
    if target != "c":
        raise InputError(f"a filter in {target} cannot be counted", where="--core", remedy="Leave it out")
    return costs(program)
