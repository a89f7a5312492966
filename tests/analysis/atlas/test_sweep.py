"""The atlas itself: how an answer is judged, swept, drawn and written."""

from __future__ import annotations

import json
import math
from pathlib import Path

import pytest
from typer.testing import CliRunner

from analysis.atlas.chart import method_atlas
from analysis.atlas.methods import METHOD_TITLES, STUDIES, chosen_studies
from analysis.atlas.report import atlas_json, write_atlas
from analysis.atlas.sweep import Answer, Axis, Map, Outcome, Study, judged, sweep
from analysis.errors import DataError, RequestError
from boat_daq.cli import app


@pytest.mark.parametrize(
    ("answer", "outcome"),
    [
        (Answer(0.5), Outcome.WORKS),
        (Answer(1.0), Outcome.WORKS),
        (Answer(1.0001), Outcome.QUIET_WRONG),
        (Answer(0.5, "a flag"), Outcome.DEGRADED),
        (Answer(math.inf, "a flag"), Outcome.DEGRADED),
        (Answer(math.inf), Outcome.QUIET_WRONG),
        (Answer(math.nan, "no span"), Outcome.REFUSED),
        (Answer(math.nan), Outcome.QUIET_WRONG),
    ],
)
def test_an_answer_is_judged_by_what_its_user_knows(answer: Answer, outcome: Outcome) -> None:
    """A wrong number, or none, is forgiven only where something was said; tolerance 1."""
    assert judged(answer, 1.0) is outcome


def ladder(x: float, y: float) -> Answer:
    """Right below 2, flagged from 2, refused from 3; wrong and silent where x and y meet at 1."""
    if x >= 3:
        raise DataError("too far", "Come back.")
    return Answer(5.0 if x == y == 1 else 0.0, "far" if x >= 2 else "")


def ladder_study() -> Study:
    return Study(
        "ladder-x", "ladder", "A ladder", "itself", "mm", 1.0, Axis("x", "mm", (0, 1, 2, 3)),
        Axis("y", "", (0, 1), ("none", "one")), ladder,
    )  # fmt: skip


def ladder_map() -> Map:
    return sweep(ladder_study())


def test_a_sweep_visits_every_place_and_counts_the_outcomes() -> None:
    """Four by two places; the one wrong and silent is found, and the refusal keeps its cause."""
    seen: list[tuple[float, float]] = []
    found = sweep(ladder_study(), lambda done, total: seen.append((done, total)))
    assert seen == [(k, 8) for k in range(1, 9)]
    assert found.counts == {"works": 3, "degraded": 2, "refused": 2, "quiet wrong": 1}
    (wrong,) = found.found(Outcome.QUIET_WRONG)
    assert (wrong.x, wrong.y) == (1, 1)
    assert found.cells[0][3].said == "too far"
    assert "quiet wrong in 1 of 8" in found.verdict


def test_a_sweep_is_cancelled_from_its_progress() -> None:
    """What the progress raises ends the sweep where it is."""

    def stop(done: float, _: float) -> None:
        if done == 3:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        sweep(ladder_study(), stop)


def test_errors_outside_the_family_are_no_refusal() -> None:
    """A crash of the method is not drawn as a refusal: it ends the sweep."""

    def crash(_x: float, _y: float) -> Answer:
        raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        Study("n", "m", "t", "", "", 1.0, Axis("x", "", (0,)), Axis("y", "", (0,)), crash).at(0, 0)


def test_the_json_says_what_the_map_says() -> None:
    """Plain JSON without NaN; labels, counts, and null where there is no error."""
    content = json.loads(json.dumps(atlas_json([ladder_map()]), allow_nan=False))
    (drawn,) = content["maps"]
    assert content["quiet_wrong"] == 1
    assert drawn["y"]["labels"] == ["none", "one"]
    assert drawn["cells"][0][3] == {"x": 3, "y": 0, "outcome": "refused", "error": None, "said": "too far"}


def test_a_picture_tells_outcomes_without_colour(tmp_path: Path) -> None:
    """Letters in the cells, words in the legend; the fourth outcome is named only where it is found."""
    figure = method_atlas([ladder_map()])
    letters = [text.get_text() for text in figure.axes[0].texts]
    assert sorted(letters) == ["!", "d", "d", "r", "r"]
    legend = [text.get_text() for text in figure.legends[0].get_texts()]
    assert len(legend) == 4
    files = write_atlas([ladder_map()], tmp_path)
    assert [f.name for f in files] == ["atlas.json", "ladder.png", "ladder.svg"]
    assert all(f.stat().st_size > 1000 for f in files)


def test_studies_are_chosen_by_method_or_map() -> None:
    """Every method of a study has a title; unknown names are refused with the known ones."""
    assert {s.method for s in STUDIES.values()} == set(METHOD_TITLES)
    assert chosen_studies([]) == list(STUDIES.values())
    assert {s.method for s in chosen_studies(["inverse"])} == {"inverse"}
    assert [s.name for s in chosen_studies(["fit-offset"])] == ["fit-offset"]
    with pytest.raises(RequestError, match="'fitt'"):
        chosen_studies(["fitt"])


def test_the_command_writes_and_ends_well(tmp_path: Path) -> None:
    """`atlas inverse --json` prints the maps and leaves pictures."""
    ran = CliRunner().invoke(app, ["atlas", "inverse", "--out", str(tmp_path), "--json"])
    assert ran.exit_code == 0, ran.output
    content = json.loads(ran.stdout)
    assert [m["name"] for m in content["maps"]] == ["inverse-turning"]
    assert (tmp_path / "inverse.svg").is_file()


def test_the_command_fails_where_a_place_is_wrong_and_silent(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A quiet wrong number is an error of the command, and says where."""
    monkeypatch.setattr("analysis.atlas.methods.chosen_studies", lambda _names: [ladder_study()])
    ran = CliRunner().invoke(app, ["atlas", "--out", str(tmp_path)])
    assert ran.exit_code == 1
    assert "1 places are wrong and silent, the first in ladder-x" in str(ran.exception)


@pytest.mark.nightly
@pytest.mark.parametrize("name", list(STUDIES))
def test_no_place_of_a_map_is_wrong_and_silent(name: str) -> None:
    """The whole map: no quiet wrong number anywhere, and the method works somewhere."""
    drawn = sweep(STUDIES[name])
    assert [(c.x, c.y, c.error) for c in drawn.found(Outcome.QUIET_WRONG)] == []
    assert drawn.found(Outcome.WORKS)
