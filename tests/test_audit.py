"""Proves what an audit says: the known answers of the literature, exactly, with names, units and words.

Row numbers are those of ``docs/observability.md``. Counts are compared with numpy's rank of observability
matrices that are built here from textbook F and H, at random numbers.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import sympy as sp
from scipy.linalg import block_diag

from kfgen.audit.audit import audit, unobservable_directions
from kfgen.audit.exact.basis import readable
from kfgen.audit.exact.chain import along
from kfgen.audit.exact.plan import Plan
from kfgen.audit.exact.symbolic import null_of, rows_of
from kfgen.effects import Effect, make
from kfgen.effects.filter_role import Use
from kfgen.manoeuvre.library import LIBRARY
from kfgen.model.filter import FilterModel
from kfgen.model.library import build
from kfgen.model.parts.motion import AtRestMotion, Strapdown
from kfgen.model.parts.sensors import AtRest, GnssPosition, GnssVelocity, MagneticField, Sensor

G = 9.80665


def skew(a: np.ndarray) -> np.ndarray:
    return np.cross(np.eye(3), a) * -1.0


def one_axis(*effects: Effect) -> FilterModel:
    return FilterModel("one", "one axis", AtRestMotion(), (AtRest(),), {"gyro_x": effects})


def hidden(model: FilterModel, sensors: Sequence[str] = ()) -> list[dict[str, float]]:
    """The hidden directions at rest."""
    used = [model.sensor(n) for n in sensors] if sensors else model.sensors
    plan = Plan(model, tuple(used))
    (h,) = along(plan, [LIBRARY["static"]])
    return [
        {s.name: float(e) for s, e in zip(model.states, v.values, strict=True) if e}
        for v in readable(plan, LIBRARY["static"], h, generic=True)
        if all(e is not None for e in v.values)
    ]


def test_row_4_ins_at_rest_hides_four_directions() -> None:
    answer = audit(build("ins15")).first
    assert (answer.states, answer.rank, answer.nullity) == (15, 11, 4)
    found = sorted((d.vector for d in answer.directions), key=str)
    wanted = [
        {"bg_D": 1.0},
        {"phi_D": 1.0},
        {"phi_E": 1.0, "ba_N": pytest.approx(-G, rel=1e-12)},
        {"phi_N": 1.0, "ba_E": pytest.approx(G, rel=1e-12)},
    ]
    assert found == wanted
    assert all(d.units.keys() == d.vector.keys() for d in answer.directions)


@pytest.mark.long
def test_what_hides_a_milliradian_is_no_more_than_all_of_a_scale_factor() -> None:
    """Normal gravity on Earth-centred axes is 1e-5 m/s^2 off the level: only 703 times its scale would hide a tilt."""
    (tilt,) = (
        d for d in audit(build("ins33", None, {"frame": "ecef"})).first.directions if "phi_y" in d.vector
    )
    shares = [abs(e) * 1e-3 for name, e in tilt.vector.items() if tilt.units[name] == "1"]
    assert len(shares) > 1
    assert max(shares) <= 1.0
    assert tilt.vector["ma_xz"] == pytest.approx(1.0, rel=1e-6)


def test_row_4_in_words() -> None:
    sentences = {d.sentence for d in audit(build("ins15")).first.directions}
    assert sentences == {
        "Heading is unobservable: no measurement depends on it",
        "Down gyro bias is unobservable: no measurement depends on it",
        "1 mrad of east tilt is hidden by -9.807 mm/s^2 of north accelerometer bias",
        "1 mrad of north tilt is hidden by 9.807 mm/s^2 of east accelerometer bias",
    }


class Heading(Sensor):
    """Tangent of the heading of the forward axis, as from two antennas."""

    title = "dual-antenna heading"
    unit = ""
    channels = ("heading",)
    sd = 0.01
    needs = ("phi",)

    def predict(self, x: Mapping[str, sp.Matrix]) -> sp.Matrix:
        return sp.Matrix([x["phi"][1, 0] / x["phi"][0, 0]])


TILTS = [
    {"phi_N": 1.0, "ba_x": 0.0, "ba_y": pytest.approx(G)},
    {"phi_E": 1.0, "ba_x": pytest.approx(-G), "ba_y": 0.0},
]


def test_row_11_heading_of_two_antennas_leaves_the_tilts() -> None:
    model = FilterModel(
        "ins+heading", "", Strapdown(), (GnssPosition(), GnssVelocity(), Heading()), build("ins15").noise
    )
    found = hidden(model)
    assert found == [{k: v for k, v in t.items() if v != 0.0} for t in TILTS]


def test_known_field_leaves_the_rotation_about_the_field() -> None:
    model = FilterModel(
        "ins+mag", "", Strapdown(), (GnssPosition(), GnssVelocity(), MagneticField()), build("ins15").noise
    )
    field = {c.name: c.value for c in model.constants}
    (found,) = hidden(model)
    assert found == {
        "phi_N": 1.0,
        "phi_D": pytest.approx(field["mag_D"] / field["mag_N"], rel=1e-12),
        "ba_y": pytest.approx(G, rel=1e-12),
    }


@pytest.mark.parametrize(
    ("used", "wanted"),
    [
        (("accel",), [{"phi_D": 1.0}, {"bg_z": 1.0}]),
        (("accel", "mag"), []),
        (("mag",), [{"phi_N": 1.0, "phi_D": 2.2}, {"bg_x": 1.0, "bg_z": 2.2}]),
    ],
    ids=["accel", "accel and mag", "mag"],
)
def test_row_14_attitude_at_rest(used: tuple[str, ...], wanted: list[dict[str, float]]) -> None:
    """The field is (20, 0, 44) uT: turning about it, by 1 and 2.2, is not seen."""
    model = build("ahrs6")
    found = hidden(model, used)
    assert [v.keys() for v in found] == [v.keys() for v in wanted]
    for v, w in zip(found, wanted, strict=True):
        assert v == pytest.approx(w, rel=1e-12)


def test_row_22_two_equal_time_constants_hide_a_difference() -> None:
    twin = make("gauss_markov", sigma=1e-3, tau=20.0), make("gauss_markov", sigma=3e-3, tau=20.0)
    (found,) = hidden(one_axis(*twin))
    assert found == {"gyro_x_gm": 1.0, "gyro_x_gm2": -1.0}


@pytest.mark.parametrize("ratio", [1.0 + 1e-9, 2.0])
def test_row_22_unequal_time_constants_are_visible(ratio: float) -> None:
    model = one_axis(
        make("gauss_markov", sigma=1e-3, tau=20.0), make("gauss_markov", sigma=3e-3, tau=20.0 * ratio)
    )
    assert hidden(model) == []


def test_row_22_gauss_markov_beside_a_walk_is_visible() -> None:
    tau = 40.0
    model = one_axis(make("gauss_markov", sigma=1e-3, tau=tau), make("rate_random_walk", K=1e-5))
    answer = audit(model).first
    assert (answer.rank, answer.nullity) == (2, 0)
    O = rows_of(model.F, model.H(model.sensors[0]), [0, 1])
    assert float(O.det()) == pytest.approx(1 / tau, rel=1e-12)


def test_temperature_must_change_to_be_distinguished_from_a_bias() -> None:
    """With a temperature whose derivatives are free the coefficient shows; without, it is the bias."""
    model = one_axis(make("rate_random_walk", K=1e-5))
    model = model.augment("gyro_x", make("temperature", coefficient=1e-5), Use(known=False))
    assert hidden(model) == []
    frozen = rows_of(model.F, model.H(model.sensors[0]), [0, 1])
    assert frozen.rank() == 1


def test_hidden_state_keeps_the_name_of_its_channel() -> None:
    """Nothing on the down gyro of an INS at rest shows; what is hidden is named as in the log."""
    model = build("ins15").augment("gyro_z", make("gauss_markov", sigma=1e-4, tau=9.0))
    sentences = [d.sentence for d in audit(model).first.directions if "gyro_z_gm" in d.vector]
    assert len(sentences) == 1
    assert "gyro_z first-order Gauss-Markov bias" in sentences[0]


def textbook_ins(model: FilterModel) -> tuple[np.ndarray, np.ndarray]:
    """p' = v, v' = f x phi + C ba (sign of true = estimate + error), phi' = -C bg; f = -g, C = 1."""
    f = np.array([0.0, 0.0, -dict(constants(model))["g"]])
    O, one = np.zeros((3, 3)), np.eye(3)
    F = np.block(
        [[O, one, O, O, O], [O, O, -skew(f), -one, O], [O, O, O, O, -one], [O, O, O, O, O], [O, O, O, O, O]]
    )
    return F, np.hstack([np.eye(6), np.zeros((6, 9))])


def textbook_ahrs(model: FilterModel) -> tuple[np.ndarray, np.ndarray]:
    """phi' = -C bg, h = C'(1 - [phi x]) m for gravity and for the field."""
    known = {"mag_N": 0.0, "mag_D": 0.0} | dict(constants(model))
    F = np.block([[np.zeros((3, 3)), -np.eye(3)], [np.zeros((3, 6))]])
    seen = [np.array([0.0, 0.0, -known["g"]]), np.array([known["mag_N"], 0.0, known["mag_D"]])]
    return F, np.vstack([np.hstack([skew(m), np.zeros((3, 3))]) for m in seen[: len(model.sensors)]])


def constants(model: FilterModel) -> list[tuple[str, float]]:
    return [(c.name, c.value) for c in model.constants]


def with_markov(
    F: np.ndarray, H: np.ndarray, places: list[int], taus: list[float]
) -> tuple[np.ndarray, np.ndarray]:
    """Gauss-Markov states that add to states (biases) of an input, wherever those act."""
    tail = block_diag(*(np.array([[-1.0 / t]]) for t in taus))
    top = np.hstack([F, F[:, places]])
    bottom = np.hstack([np.zeros((len(taus), F.shape[0])), tail])
    return np.vstack([top, bottom]), np.hstack([H, H[:, places]])


def numpy_rank(F: np.ndarray, H: np.ndarray) -> int:
    rows = [H]
    for _ in range(F.shape[0] - 1):
        rows.append(rows[-1] @ F)
    O = np.vstack(rows)
    O = O / np.maximum(np.linalg.norm(O, axis=1, keepdims=True), 1e-300)
    return int(np.linalg.matrix_rank(O, tol=1e-9))


TEXTBOOK: dict[str, tuple[Callable[..., Any], int]] = {
    "ins15": (textbook_ins, 12),
    "ahrs6": (textbook_ahrs, 3),
}


@pytest.mark.parametrize("sensors", [1, 2])
@pytest.mark.parametrize("name", TEXTBOOK)
@pytest.mark.parametrize("axes", ["", "x", "xz", "zz"])
@pytest.mark.parametrize("seed", range(2))
def test_rank_is_numpys_rank_of_the_textbook_matrices(name: str, sensors: int, axes: str, seed: int) -> None:
    rng = np.random.default_rng(seed)
    base = build(name)
    model = FilterModel(name, "", base.motion, base.sensors[:sensors], base.noise)
    taus = [round(t, 3) for t in rng.uniform(0.8, 2.0, len(axes))]
    for axis, tau in zip(axes, taus, strict=True):
        model = model.augment(f"gyro_{axis}", make("gauss_markov", sigma=1e-3, tau=tau))
    build_matrices, gyro = TEXTBOOK[name]
    F, H = build_matrices(model)
    H = H[: 3 * sensors]
    if axes:
        F, H = with_markov(F, H, [gyro + "xyz".index(a) for a in axes], taus)
    assert F.shape[0] == len(model.states)
    assert len(model.states) - len(hidden(model)) == numpy_rank(F, H)


def test_json_is_as_promised(kfgen: Callable[..., Any], tmp_path: Path) -> None:
    done = kfgen("audit", "ins15", "--json", tmp_path / "a.json")
    assert done.exit_code == 0
    data = json.loads((tmp_path / "a.json").read_text())
    assert data["format"] == "kfgen-audit-1"
    assert data["model"] == "ins15"
    static = data["manoeuvres"]["static"]
    assert {k: static[k] for k in ("states", "rank", "nullity")} == {"states": 15, "rank": 11, "nullity": 4}
    assert "raw" in static["condition"]
    for direction in static["directions"]:
        assert direction.keys() >= {"vector", "units", "sentence", "freed_by"}
        assert direction["units"].keys() == direction["vector"].keys()
        assert direction["sentence"] in done.stdout
    assert {"phi_E": "rad", "ba_N": "m/s^2"} in [d["units"] for d in static["directions"]]


def test_unknown_manoeuvre_is_bad_usage(kfgen: Callable[..., Any]) -> None:
    assert kfgen("audit", "ins15", "--manoeuvre", "loop").exit_code == 2


def test_row_1_linearised_at_a_point_keeps_its_parameters() -> None:
    """Hemerly's filter with its matrices held (eqs 19-22): the rank is 3 of 5 for every parameter value."""
    x1, x2, B, K, beta, r = sp.symbols("x1 x2 B K beta r", positive=True)  # r = sqrt(K^2 + beta^2 B^2)
    F = sp.Matrix([x2, -beta * x2, 0, 0, 0]).jacobian([x1, x2, B, K, beta])
    H = sp.Matrix(
        [[K * beta, r, beta**2 * B * x2 / r, beta * x1 + K * x2 / r, K * x1 + beta * B**2 * x2 / r]]
    )
    basis = null_of(F, H)
    assert len(basis) == 2
    expected = [
        sp.Matrix([-B * beta * x2 / (K * r), 0, 1, 0, 0]),
        sp.Matrix([-(K * x2 + r * beta * x1) / (K * r * beta), 0, 0, 1, 0]),
    ]
    at = {x1: 7, x2: -3, B: 2, K: 3, beta: 2, r: 5}
    for v in expected:
        together = sp.Matrix.hstack(*basis, v).subs(at)
        assert (rows_of(F, H, range(5)) * v).subs(at).is_zero_matrix
        assert together.rank() == 2


def test_row_2_keeps_gravity_and_earth_rate_as_symbols() -> None:
    """Stationary alignment, vN vE phi bg baN baE: the three directions with their parameters."""
    g, N, D = sp.symbols("g W_N W_D", real=True)
    F = sp.zeros(10, 10)
    F[0, 3], F[0, 8], F[1, 2], F[1, 9] = g, 1, -g, 1
    F[2, 3], F[3, 4], F[3, 2], F[4, 3] = D, N, -D, -N
    F[2, 5] = F[3, 6] = F[4, 7] = -1
    H = sp.eye(10)[:2, :]
    basis = sp.Matrix.hstack(*null_of(F, H))
    assert basis.cols == 3
    expected = (
        {4: 1, 6: N},
        {3: 1, 5: D, 7: -N, 8: -g},
        {2: 1, 4: D / N, 9: g},
    )
    for direction in expected:
        v = sp.Matrix([direction.get(k, 0) for k in range(10)])
        assert sp.Matrix.hstack(basis, v).rank(simplify=True) == 3


def test_amounts_are_exact_and_in_parameters() -> None:
    tilt = next(d for d in audit(build("ins15")).first.directions if "phi_E" in d.vector)
    assert tilt.exact == {"phi_E": "1", "ba_N": "-196133/20000"}
    assert tilt.formula == {"phi_E": "1", "ba_N": "-g"}


def test_table_says_what_frees_what() -> None:
    """Rows 4, 6, 9 and 14: turning about the vertical frees tilts, not heading; level flight in turns frees all."""
    answer = audit(build("ins15"))
    freeing = {"+".join(d.vector): set(d.freed_by) for d in answer.first.directions}
    assert "yaw-turn" in freeing["phi_E+ba_N"]
    assert "yaw-turn" in freeing["phi_N+ba_E"]
    assert not freeing["phi_D"] & {"yaw-turn", "two-position", "six-position", "cruise", "hover"}
    assert "six-position" in freeing["bg_D"]
    assert "accelerate" not in freeing["phi_N+ba_E"]
    assert answer.table is not None
    assert answer.table.shortest is LIBRARY["s-turn"]


@pytest.mark.long
def test_gauges_are_named() -> None:
    from audit_models import FEATURE, With, camera, model

    answer = audit(model(With(Strapdown(), FEATURE), camera), (LIBRARY["generic"],)).first
    assert [d.sentence for d in answer.directions] == [
        "Moving everything north is unobservable: it changes no measurement",
        "Moving everything east is unobservable: it changes no measurement",
        "Moving everything down is unobservable: it changes no measurement",
        "Turning everything about the vertical is unobservable: it changes no measurement",
    ]
    turning = answer.directions[-1].vector
    assert turning == pytest.approx({"phi_D": 1.0, "f1_N": -5.0, "f1_E": 30.0})


@pytest.mark.long
def test_amounts_are_numbers_where_the_start_is_level_to_the_last_digit_only() -> None:
    """A body with level axes, in Earth axes: each component of the field is hidden by the iron along its own axis."""
    chosen = {
        "frame": "ecef",
        "sensors": "gnss_position,gnss_velocity,mag",
        "field": "vector",
        "hard_iron": "true",
    }
    found = [dict(d.vector) for d in unobservable_directions(build("ins9", None, chosen))]
    wanted = {"mag_N": "b_mag_x", "mag_E": "b_mag_y", "mag_D": "b_mag_z"}
    assert len(found) == len(wanted)
    for amounts in found:
        (field, one), (iron, less) = amounts.items()
        assert (wanted[field], one) == (iron, 1.0)
        assert less == pytest.approx(-1.0, abs=1e-9)
