"""What every test may use."""

from __future__ import annotations

import functools
import gc
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
from hypothesis import settings

import boat_daq  # noqa: F401  before numpy: it gives the BLAS one thread, as the program does

pytest_plugins = ("tests.outside_writes",)

if TYPE_CHECKING:
    from analysis.optics.scene.frame import SceneFrame
    from analysis.shadow.fem.parameters import ActuatorParameters
    from analysis.shadow.model.full import FullModel
    from analysis.shadow.model.reduced import ReducedModel
    from boat_daq.engine.session.session import Session
    from boat_daq.engine.snapshot import SessionSnapshot
    from protocol.base.arrays import FloatArray

ROOT = Path(__file__).resolve().parents[1]

settings.register_profile("daily", max_examples=25, deadline=None)
settings.register_profile("nightly", max_examples=1000, deadline=None)
settings.load_profile("daily")

gc.disable()  # while tests are collected: what is imported stays


def pytest_collection_finish() -> None:
    """Collect garbage again, loaded modules excluded: full collections become cheap."""
    gc.collect()
    gc.freeze()
    gc.collect()  # counts what is left: next to nothing
    gc.enable()


def reached(session: Session, condition: Callable[[SessionSnapshot], bool], seconds: float) -> SessionSnapshot:
    """Return the first snapshot that meets the condition; fail if none does in time."""
    met = False

    def holds(seen: SessionSnapshot) -> bool:
        nonlocal met
        met = condition(seen)
        return met

    seen = session.wait(holds, seconds)
    assert met, f"not reached: {seen.state}, {seen.link}, {[m.cause for m in seen.messages][-5:]}"
    return seen


def mostly_at_night(*cases: Any, by_day: int = 1) -> list[Any]:
    """Return the cases of a test, one value or a tuple each: `by_day` run with every change, the others at night."""
    others = (case if isinstance(case, tuple) else (case,) for case in cases[by_day:])
    return [*cases[:by_day], *(pytest.param(*case, marks=pytest.mark.nightly) for case in others)]


@pytest.fixture(scope="session", autouse=True)
def home(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """Settings, units and logs in a folder of their own, also for the programs that a test starts."""
    folder = tmp_path_factory.mktemp("home")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("BOAT_DAQ_HOME", str(folder))
        yield folder


@pytest.fixture(scope="session", autouse=True)
def one_tree_of_commands() -> Iterator[None]:
    """Build typer's tree of commands once, not again at every call of the command line."""
    import typer.main
    import typer.testing

    built = functools.cache(typer.main.get_command)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(typer.main, "get_command", built)
        patch.setattr(typer.testing, "_get_command", built)
        yield


@pytest.fixture(scope="session", autouse=True)
def limits_once() -> Iterator[None]:
    """Walk to the limits of an actuator once, not again in every model of it: they follow from parameters and mesh."""
    from analysis.shadow.model.full import FullModel

    known: dict[Any, Any] = {}
    walk = {name: vars(FullModel)[name].func for name in ("vacuum_limit", "inflation_limit")}

    def limit(name: str, model: FullModel) -> Any:
        key = (name, model.parameters, model.mesh.nodes.tobytes())
        if key not in known:
            known[key] = walk[name](model)
        return known[key]

    with pytest.MonkeyPatch.context() as patch:
        for name in walk:
            patch.setattr(FullModel, name, property(functools.partial(limit, name)))
        yield


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """Return the folder of third-party recordings and certified data, which is not part of the repository."""
    folder = ROOT.parent / "shared" / "data"
    if not folder.is_dir():
        pytest.skip("the shared data folder is not beside this checkout")
    return folder


@pytest.fixture(scope="session")
def curves() -> FloatArray:
    """Return the 15 states of the parametric set, whose lengths are known."""
    from analysis.optics.scene.curves import parametric_curves

    return parametric_curves()


@pytest.fixture(scope="session")
def frames(curves: FloatArray) -> list[SceneFrame]:
    """Return the frames of these states with the default guide."""
    from analysis.optics.scene.curves import frames_of
    from analysis.optics.scene.parameters import Waveguide

    return frames_of(curves, Waveguide())


@pytest.fixture(scope="session")
def actuator() -> FullModel:
    """Return the paper's actuator."""
    from analysis.shadow.model.full import FullModel

    return FullModel()


@pytest.fixture(scope="session")
def table() -> ReducedModel:
    """Return the reduced model of the paper's actuator, built in this run: its home folder was empty."""
    from analysis.shadow.model.table import load_table

    return load_table()


@pytest.fixture(scope="session")
def short() -> ActuatorParameters:
    """Return two bladders on a coarse mesh: every step at a tenth of the cost."""
    from analysis.shadow.fem.parameters import ActuatorParameters

    return ActuatorParameters(cells=2, axial_elements=6, wall_elements=1, lattice_elements=3)
