"""The folder of an emitted filter: its files, and a manifest from which it can be rebuilt."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import kfgen
from kfgen.core.errors import InputError
from kfgen.core.files.destination import check_folder
from kfgen.core.files.whole_file import sha256_of, write_whole_folder
from kfgen.core.result import Result, ShortTable
from kfgen.effects.noise_model import NoiseModel, noise_text, read_noise
from kfgen.emit import targets
from kfgen.emit.cautions import cautions
from kfgen.emit.routines import Program
from kfgen.emit.watch.parts import checked
from kfgen.model.discretise import DiscreteModel
from kfgen.model.filter_file import FilterFile, filter_text
from kfgen.model.library import build
from kfgen.model.plant.equations import Equations
from kfgen.model.plant.file import model_text

MANIFEST = "kfgen.json"
NOISE = "noise.toml"
MODEL = "model.toml"
FILTER = "filter.toml"
FORMAT = "kfgen-manifest-1"
MAX_NUMBER = 1e15
"""In a manifest."""
PYTHON_CACHE = "__pycache__"


@dataclass(frozen=True, repr=False)
class EmittedFilter(Result):
    """A filter as code.

    Parameters
    ----------
    program : Program
        Its routines.
    target : str
        The language, a key of `kfgen.emit.targets`.
    folder : Path
        Where its files are.
    files : tuple of str
        Their names.
    """

    program: Program
    target: str
    folder: Path
    files: tuple[str, ...] = ()

    @property
    def model_hash(self) -> str:
        """SHA-256 of the filter's equations and numbers, as it stands in the files."""
        return self.program.discrete.hash

    def summary(self) -> list[str]:
        """Where it is, its size, and its cost on a processor where that was counted."""
        program = self.program
        operations = ", ".join(f"{r.name} {r.operations}" for r in program.routines if r.operations)
        return [
            f"{program.discrete.model.name} as {self.target} in {self.folder}: {', '.join(self.files)}",
            f"{program.n} states, hash {self.model_hash[:16]}; operations: {operations}",
            *program.costs[:3],
        ]

    def short_table(self) -> ShortTable:
        """Operations of each routine."""
        rows = [[r.name, str(r.operations)] for r in self.program.routines if r.operations]
        return ("routine", "operations"), rows

    def to_dict(self) -> dict[str, Any]:
        """The model, the choices, the files and the operations of each routine."""
        program = self.program
        return {
            "format": "kfgen-emit-1",
            "kfgen": kfgen.__version__,
            "model": program.discrete.model.name,
            "target": self.target,
            "model_hash": self.model_hash,
            "form": program.form,
            "real": program.real,
            "loops": program.loops,
            "files": list(self.files),
            "warnings": list(cautions(program)),
            "operations": {r.name: r.operations for r in program.routines},
        }


def write_folder(
    program: Program, target: str, noise: NoiseModel | None, folder: str | Path, force: bool = False
) -> list[str]:
    """Write a filter's files, all or none; returns their names.

    Parameters
    ----------
    program : Program
        The filter and how it is written.
    target : str
        A key of `kfgen.emit.targets`.
    noise : NoiseModel or None
        What the filter was built with; goes into the folder, so that it can be built again.
    folder : path-like
        A new folder, an empty one, or one of an emitted filter, which is replaced.
    force : bool
        Replace also files that were changed since they were written.

    Raises
    ------
    InputError
        An unknown target, or a folder that holds files of other origin or changed ones.
    """
    if target not in targets():
        raise InputError(
            f"there is no target '{target}'", where="--target", remedy=f"Known are {', '.join(targets())}"
        )
    folder = Path(folder).resolve()
    _check_free(folder, force)
    files = dict(targets()[target].files(program))
    if noise is not None:
        files[NOISE] = noise_text(noise)
    discrete = program.discrete
    motion = discrete.model.motion
    if isinstance(motion, Equations):
        files[MODEL] = model_text(motion.user)
    if isinstance(discrete.model.given, FilterFile):
        files[FILTER] = filter_text(discrete.model.given)
    manifest = {
        "format": FORMAT,
        "kfgen": kfgen.__version__,
        "model": discrete.model.name,
        "target": target,
        "model_hash": discrete.hash,
        "order": discrete.order,
        "max_step": discrete.max_step,
        "rate": discrete.rate,
        "form": program.form,
        "real": program.real,
        "loops": program.loops,
        "q_interval": program.noise_waits,
        "horizon": program.horizon,
        "without": list(program.without),
        "lanes": program.lanes,
        "options": dict(discrete.model.options),
        "noise": noise is not None,
        "files": sorted(files),
        "sha256": {name: sha256_of(text.encode()) for name, text in sorted(files.items())},
    }
    files[MANIFEST] = json.dumps(manifest, indent=1) + "\n"
    with write_whole_folder(folder) as fresh:
        for name, text in files.items():
            (fresh / name).parent.mkdir(exist_ok=True)
            (fresh / name).write_text(text, encoding="utf-8")
    return sorted(files)


def _check_free(folder: Path, force: bool) -> None:
    if not folder.exists():
        return
    check_folder(folder, folder)
    found = (p for p in folder.rglob("*") if not p.is_dir() and p.parent.name != PYTHON_CACHE)
    present = {p.relative_to(folder).as_posix() for p in found}
    present |= {p.name for p in folder.iterdir() if p.is_dir() and not any(p.iterdir())}
    if not present:
        return
    manifest = _manifest(folder) if MANIFEST in present else {"files": []}
    known = {*manifest["files"], MANIFEST} if MANIFEST in present else set()
    strangers = sorted(present - known)
    if strangers:
        raise InputError(
            f"the folder holds other files ({', '.join(strangers[:3])})",
            where=str(folder),
            remedy="Give a new folder with -o",
        )
    written = manifest.get("sha256")
    if isinstance(written, dict) and not force:
        for name in sorted(present & known - {MANIFEST}):
            _check_unchanged(folder, name, written.get(name))


def _check_unchanged(folder: Path, name: str, written: object) -> None:
    if sha256_of((folder / name).read_bytes()) != written:
        raise InputError(
            f"the file {name} was changed since kfgen wrote it, and would be lost",
            where=str(folder),
            remedy="Give a new folder with -o, or --force to replace it",
        )


def _manifest(folder: Path) -> dict[str, Any]:
    path = folder / MANIFEST
    try:
        manifest = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise InputError(
            "it is no emitted filter: there is no kfgen.json in it",
            where=str(folder),
            remedy="Make one with: kfgen emit MODEL --target c -o DIR",
        ) from None
    except (ValueError, RecursionError) as error:
        raise InputError(
            f"it is no JSON: {error}", where=str(path), remedy="Emit the filter again into a new folder"
        ) from None
    if (
        not isinstance(manifest, dict)
        or manifest.get("format") != FORMAT
        or not isinstance(manifest.get("files"), list)
        or not all(isinstance(name, str) for name in manifest["files"])
        or manifest.get("target") not in targets()
    ):
        raise InputError(
            "it is no manifest of kfgen", where=str(path), remedy="Emit the filter again into a new folder"
        )
    return manifest


def _number(folder: Path, manifest: dict[str, Any], key: str, default: float | None = None) -> float:
    """A finite number of a manifest."""
    value = manifest.get(key, default)
    if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) < MAX_NUMBER:
        raise InputError(
            f"its {key} is {value!r} and no number", where=str(folder / MANIFEST), remedy="Emit it again"
        )
    return float(value)


def _model_of(folder: Path, manifest: dict[str, Any]) -> str:
    own = [folder / name for name in (FILTER, MODEL) if name in manifest["files"]]
    return str(own[0] if own else manifest["model"])


def _options_of(folder: Path, manifest: dict[str, Any]) -> dict[str, str]:
    options = {} if FILTER in manifest["files"] else manifest.get("options", {})
    if not isinstance(options, dict) or not all(isinstance(v, str) for v in options.values()):
        raise InputError("its options are no table of texts", where=str(folder / MANIFEST))
    return options


def read_folder(folder: str | Path) -> EmittedFilter:
    """Rebuild the filter that a folder was emitted from.

    Raises
    ------
    InputError
        No manifest, a broken one, or one whose model this kfgen derives differently.
    """
    folder = Path(folder)
    if not folder.is_dir():
        raise InputError("no such folder", where=str(folder))
    manifest = _manifest(folder)
    missing = [name for name in manifest["files"] if not (folder / name).is_file()]
    if missing:
        raise InputError(f"the file {missing[0]} is missing", where=str(folder), remedy="Emit it again")
    noise = read_noise(folder / NOISE) if manifest.get("noise") else None
    try:
        discrete = DiscreteModel(
            build(_model_of(folder, manifest), noise, _options_of(folder, manifest)),
            order=int(_number(folder, manifest, "order")),
            max_step=_number(folder, manifest, "max_step"),
            rate=_number(folder, manifest, "rate"),
        )
    except (KeyError, ValueError, TypeError, AttributeError) as error:
        raise InputError(f"it lacks or garbles {error}", where=str(folder / MANIFEST)) from None
    if discrete.hash != manifest.get("model_hash"):
        raise InputError(
            "its model has another hash than this kfgen derives",
            where=str(folder / MANIFEST),
            remedy="Emit it again",
        )
    without = manifest.get("without", [])
    if not isinstance(without, list) or not all(isinstance(name, str) for name in without):
        raise InputError(
            "what it is without is no list of texts", where=str(folder / MANIFEST), remedy="Emit it again"
        )
    q_interval = _number(folder, manifest, "q_interval", 0.0)
    horizon = _number(folder, manifest, "horizon", 0.0)
    options = manifest.get("form", "p"), manifest.get("real", "float"), manifest.get("loops", False) is True
    return EmittedFilter(
        Program(
            discrete,
            str(options[0]),
            str(options[1]),
            options[2],
            q_interval,
            horizon=horizon,
            without=checked(without),
            lanes=manifest.get("lanes") is True,
        ),
        str(manifest.get("target")),
        folder,
        tuple(manifest["files"]),
    )
