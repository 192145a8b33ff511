"""The verb `audit`: what a filter cannot see, along manoeuvres or in a log.

It stands here, above `kfgen.audit`, because a log is looked at through a filter that runs over it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from kfgen.audit.audit import audit as along
from kfgen.audit.audit import in_log
from kfgen.audit.degree import Horizon
from kfgen.audit.result import Audited, WantedAccuracy
from kfgen.core.errors import InputError
from kfgen.core.files.whole_file import hashes
from kfgen.log.readers import LogOrPath, log_of
from kfgen.manoeuvre.file import manoeuvre
from kfgen.manoeuvre.manoeuvre import Manoeuvre
from kfgen.model.build import ModelSource, NoiseSource, filter_of
from kfgen.model.filter import FilterModel
from kfgen.run.filter_log import as_named_by
from kfgen.run.run import program_over, run


def audit(  # noqa: PLR0913 - the choices of one command
    model: ModelSource,
    manoeuvres: Sequence[str | Path | Manoeuvre] | str = (),
    noise: NoiseSource | None = None,
    duration: float | None = None,
    rate: float = 100.0,
    *,
    log: LogOrPath | None = None,
    want: Sequence[str] = (),
    files: Sequence[str | Path] = (),
) -> Audited:
    """What measurements cannot tell, what would make it visible, and how well each state shows.

    Parameters
    ----------
    model : FilterModel, str or Path
        A filter of `kfgen.build`, the name of a library model, or the path of a filter file or a model file.
    manoeuvres : sequence of str, Path or Manoeuvre, optional
        Names of the library (see `kfgen.list_all`), files, or manoeuvres; at rest where left out.
    noise : NoiseModel or path-like, optional
        The effects of the channels; only beside a name or a path.
    duration : float, optional
        How long is measured [s]; the length of each manoeuvre where left out.
    rate : float
        Samples of every sensor [Hz].
    log : Log or path-like, optional
        In place of manoeuvres: how well each state shows in this log.
    want : sequence of str
        Standard deviations to be reached, ``"phi_D=0.1 deg"``; when, the result says.
    files : sequence of str or Path
        Of which the model was made, for the hashes of the inputs.

    Returns
    -------
    Audited

    Raises
    ------
    InputError
        As in `kfgen.build`, no such manoeuvre, or a log beside manoeuvres.
    """
    names = (manoeuvres,) if isinstance(manoeuvres, str) else tuple(dict.fromkeys(manoeuvres))
    if log is not None:
        if names:
            raise InputError(
                "a log has its own motion", where="--manoeuvre", remedy="Give --log or --manoeuvre"
            )
        recorded = log_of(log)
        found = _over_log(filter_of(model, noise), recorded)
        inputs = {recorded.source: recorded.sha256}
    else:
        flown = [m if isinstance(m, Manoeuvre) else manoeuvre(str(m)) for m in names]
        found = along(filter_of(model, noise), flown, Horizon(duration, rate))
        given = (model, noise, *files, *names)
        inputs = hashes(Path(g) for g in given if isinstance(g, str | Path) and str(g).endswith(".toml"))
    wanted = tuple(WantedAccuracy.parse(w, found.first) for w in want)
    return replace(found, wanted=wanted, inputs=inputs)


def _over_log(model: FilterModel, log: LogOrPath) -> Audited:
    """The covariance of the filter that runs over a log, with the sensors that the log has."""
    recorded = as_named_by(model, log_of(log))
    result = run(program_over(model, recorded), recorded)
    present = tuple(s for s in model.sensors if s.name in result.sensors)
    name = Path(recorded.source).name or recorded.source
    return in_log(replace(model, sensors=present), name, recorded.t, result.deviation)
