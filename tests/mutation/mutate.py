"""Mutation testing: small faults in the modules that others rest on, and which of them no test notices.

`make mutation`, or `python -m tests.mutation.mutate [MODULE ...] [COUNT]`, makes Cosmic Ray's mutants of `MODULES`,
tries those that have no result yet, or COUNT of each module drawn at random, always the same ones, and writes
their scores to scores.csv. Results are kept in FOLDER, by the source and the tests that they are of. Reasons of
survivors are in survivors.toml.

Strategy: Cosmic Ray changes the source; its own runner would start Python for every mutant. Here one process imports
and collects once; each mutant is a fork of it, in which the compiled functions of the mutated source replace those of
the module. It runs the tests that reach the mutated statement, those of a shared fixture included, until one fails.

Operators are the sufficient set of A. J. Offutt et al., "An experimental determination of sufficient mutant
operators", ACM TOSEM 5 (1996) 99-118, one for each relation and operation, and numbers plus and minus one.
"""

from __future__ import annotations

import ast
import hashlib
import json
import os
import pickle
import random
import resource
import signal
import subprocess
import sys
import time
import types
from collections import defaultdict
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np  # noqa: F401  what all modules import, before any fork
import pytest

ROOT = Path(__file__).resolve().parents[2]
FOLDER = ROOT / "out" / "mutation"

_SESSION = "tests/boat_daq/engine/session"
_FIGURES, _CALIBRATION = "tests/analysis/figures", "tests/analysis/calibration"
_OUTLETS = "tests/boat_daq/engine/outlets"
_CONTROL, _RECORDING, _LINK = "tests/boat_daq/engine/control", "tests/boat_daq/engine/recording", "tests/protocol/link"
MODULES: dict[str, tuple[str, ...]] = {  # the tests that reach most of a module, by coverage
    "analysis/conformity.py": ("tests/analysis/test_conformity.py", f"{_FIGURES}/test_acceptance.py"),
    "analysis/figures/acceptance.py": (f"{_FIGURES}/test_acceptance.py",),
    "analysis/calibration/inverse.py": (f"{_CALIBRATION}/test_inverse.py",),
    "analysis/figures/uncertainty.py": (f"{_FIGURES}/test_uncertainty.py",),
    **{
        f"analysis/figures/{name}.py": (f"{_FIGURES}/test_{name}.py",)
        for name in ("intervals", "curve_figures", "loop_figures", "noise_figures", "cycle_figures")
    },
    "boat_daq/engine/control/interlock.py": (f"{_CONTROL}/test_interlock.py",),
    "boat_daq/engine/control/sequencer.py": tuple(
        f"{_CONTROL}/test_{name}.py" for name in ("sequencer", "sequencer_by_hand", "segment_watch")
    ),
    "protocol/link/connection.py": tuple(
        f"{_LINK}/test_{name}.py"
        for name in ("connection_layout", "connection", "connection_vectors", "pending_commands")
    ),
    "protocol/link/pending_commands.py": (f"{_LINK}/test_pending_commands.py", f"{_LINK}/test_connection.py"),
    "protocol/link/sample_stream.py": (
        *(f"{_LINK}/test_{name}.py" for name in ("sample_stream", "connection")),
        "tests/protocol/text/test_connection.py",
    ),
    "boat_daq/engine/session/guarded_controller.py": (f"{_SESSION}/test_guarded_controller.py",),
    "boat_daq/engine/session/shared_vent.py": (f"{_SESSION}/test_shared_vent.py",),
    "boat_daq/engine/recording/rows.py": (f"{_RECORDING}/test_recorder.py", f"{_RECORDING}/test_resumption.py"),
    "boat_daq/engine/outlets/secop_server.py": ("tests/boat_daq/engine/outlets/test_secop_server.py",),
    "analysis/elongation_control/controller.py": ("tests/analysis/elongation_control/test_controller.py",),
    "analysis/certificates/dcc.py": ("tests/analysis/certificates/test_dcc.py",),
    "analysis/tracking/tracker.py": ("tests/analysis/tracking/test_tracker.py", "tests/analysis/tracking/test_lens.py"),
    "boat_daq/engine/recording/recorder.py": tuple(
        f"{_RECORDING}/test_{name}.py"
        for name in ("recorder", "recorder_waiting", "recorder_disk", "recorder_names", "resumption")
    ),
    "boat_daq/engine/outlets/secop_node.py": tuple(f"{_OUTLETS}/test_secop_{name}.py" for name in ("node", "server")),
    "boat_daq/engine/outlets/lsl.py": (f"{_OUTLETS}/test_lsl.py",),
    **dict.fromkeys(
        (
            "protocol/recording/damaged_log.py",
            "boat_daq/engine/recording/recovery.py",
            *(f"boat_daq/engine/recording/salvage/{name}.py" for name in ("derive_again", "salvaged_file")),
        ),
        (f"{_RECORDING}/test_recovery_damage.py", f"{_RECORDING}/test_recovery.py"),
    ),
    **dict.fromkeys(
        (f"boat_daq/engine/control/{name}.py" for name in ("controller", "board_commands", "watchdog")),
        (
            *(f"{_CONTROL}/test_{name}.py" for name in ("board_commands_latest", "controller", "elongation")),
            *(f"{_CONTROL}/test_{name}.py" for name in ("controller_random_orders", "watchdog")),
            f"{_SESSION}/test_guarded_controller.py",
        ),
    ),
    "boat_daq/engine/control/elongation.py": (f"{_CONTROL}/test_elongation.py",),
    "boat_daq/engine/control/plateau_dwell.py": (f"{_CONTROL}/test_plateau_dwell_drift.py",),
    "boat_daq/engine/recording/file.py": tuple(
        f"{_RECORDING}/test_{name}.py" for name in ("file_disk_space", "recorder", "recorder_disk", "recovery_damage")
    ),
    "boat_daq/engine/recording/summary.py": tuple(
        f"{_RECORDING}/test_{name}.py" for name in ("summary", "recovery_damage")
    ),
    "boat_daq/engine/recording/verify.py": tuple(
        f"{_RECORDING}/test_{name}.py" for name in ("verify", "recovery_damage")
    ),
    "boat_daq/engine/recording/resumption.py": (f"{_RECORDING}/test_resumption.py",),
    "boat_daq/engine/recording/rename.py": (f"{_RECORDING}/test_rename.py",),
}
_COMPARISONS = {  # one relation that moves the border, one that turns it round
    "Lt": ("LtE", "GtE"), "LtE": ("Lt", "Gt"), "Gt": ("GtE", "LtE"), "GtE": ("Gt", "Lt"), "Eq": ("NotEq",),
    "NotEq": ("Eq",), "Is": ("IsNot",), "IsNot": ("Is",),
}  # fmt: skip
_BINARY = {
    "Add": "Sub", "Sub": "Add", "Mul": "Div", "Div": "Mul", "Pow": "Mul", "FloorDiv": "Mul", "Mod": "Mul",
    "BitAnd": "BitOr", "BitOr": "BitAnd", "LShift": "RShift", "RShift": "LShift",
}  # fmt: skip
OPERATORS = (
    *(f"core/ReplaceComparisonOperator_{a}_{b}" for a, others in _COMPARISONS.items() for b in others),
    *(f"core/ReplaceBinaryOperator_{a}_{b}" for a, b in _BINARY.items()),
    *(f"core/ReplaceUnaryOperator_Delete_{sign}" for sign in ("USub", "Not", "Invert")),
    "core/AddNot", "core/ReplaceTrueWithFalse", "core/ReplaceFalseWithTrue", "core/ReplaceAndWithOr",
    "core/ReplaceOrWithAnd", "core/ReplaceBreakWithContinue", "core/ReplaceContinueWithBreak",
    "core/ExceptionReplacer", "core/NumberReplacer", "core/ZeroIterationForLoop",
)  # fmt: skip
_GUARDS = ("strict", "slots", "frozen")  # keywords
_LEAST_CPU_S, _LEAST_WALL_S = 10, 60.0


# ---- mutants ---------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Mutant:
    """A change of one place: the operator, the line (from 1), and the source after it."""

    operator: str
    line: int
    source: str

    @property
    def change(self) -> str:
        """The mutated line."""
        return self.source.splitlines()[self.line - 1].strip()


def mutants_of(source: str) -> Iterator[Mutant]:
    """Yield the mutants that Cosmic Ray makes of a module in random order, always the same one.

    None that changes an annotation only.
    """
    from cosmic_ray.ast import ast_nodes, get_ast
    from cosmic_ray.plugins import get_operator

    tree = get_ast(source)
    kept = pickle.dumps(tree)
    meaning = _meaning(source)
    operators = {name: get_operator(name)() for name in OPERATORS}
    places = [
        (name, node, index, start[0])
        for name, operator in operators.items()
        for node in ast_nodes(tree)
        for index, (start, _) in enumerate(operator.mutation_positions(node))
    ]
    for name, node, index, line in random.Random(0).sample(places, len(places)):
        with suppress(SyntaxError, AttributeError):  # Cosmic Ray replaces no exception whose name has a dot
            mutated = _mutated(pickle.loads(kept), node, lambda same, n=name, i=index: operators[n].mutate(same, i))
            if _meaning(mutated) != meaning:
                yield Mutant(name.removeprefix("core/"), line, mutated)


def _mutated(copy: Any, node: Any, mutate: Callable[[Any], Any]) -> str:
    """Return the source of a copy of a tree with the copy of one node mutated."""
    places = []
    while node.parent is not None:
        places.append(next(at for at, child in enumerate(node.parent.children) if child is node))
        node = node.parent
    same = copy
    for at in reversed(places):
        parent, same = same, same.children[at]
    parent.children[places[0]] = mutate(same)
    return str(copy.get_code())


def _meaning(source: str) -> str:
    """Return the syntax tree without annotations, and without what only guards against a programmer's mistake."""
    tree = ast.parse(source)
    for node in ast.walk(tree):
        if isinstance(node, ast.Call):
            node.keywords = [keyword for keyword in node.keywords if keyword.arg not in _GUARDS]
        if isinstance(node, ast.arguments):  # a bare * is no product
            node.args, node.posonlyargs, node.kwonlyargs = node.posonlyargs + node.args + node.kwonlyargs, [], []
            node.defaults, node.kw_defaults = [*node.defaults, *filter(None, node.kw_defaults)], []
        if isinstance(node, ast.AnnAssign | ast.arg):
            node.annotation = ast.Constant(None) if isinstance(node, ast.AnnAssign) else None
        elif isinstance(node, ast.FunctionDef):
            node.returns = None
    return ast.dump(tree)


def replace_code(module: types.ModuleType, source: str) -> None:
    """Give a loaded module the functions and values of a mutated source, wherever they were imported to."""
    new = types.ModuleType(module.__name__)
    new.__file__ = module.__file__
    sys.modules[module.__name__] = new  # dataclasses look themselves up
    try:
        exec(compile(source, str(module.__file__), "exec"), vars(new))
    finally:
        sys.modules[module.__name__] = module
    for name, value in vars(new).items():
        old = vars(module).get(name)
        if name.startswith("__") or isinstance(value, types.ModuleType):
            continue
        if isinstance(value, type) and value.__module__ == module.__name__ and isinstance(old, type):
            _replace_class(old, value)
        elif not _replace_function(old, value) and repr(old) != repr(value):
            for other in list(sys.modules.values()):
                if getattr(other, "__dict__", {}).get(name) is old:
                    setattr(other, name, value)


def _replace_class(old: type, new: type) -> None:
    for name, value in vars(new).items():
        before = vars(old).get(name)
        if isinstance(value, property) and isinstance(before, property):
            _replace_function(before.fget, value.fget)
        elif isinstance(value, cached_property) and isinstance(before, cached_property):
            _replace_function(before.func, value.func)
        elif isinstance(value, staticmethod | classmethod) and isinstance(before, staticmethod | classmethod):
            _replace_function(before.__func__, value.__func__)
        elif not _replace_function(before, value) and isinstance(value, int | float) and value != before:
            setattr(old, name, value)


def _replace_function(old: Any, new: Any) -> bool:
    old, new = getattr(old, "__wrapped__", old), getattr(new, "__wrapped__", new)
    if not (isinstance(old, types.FunctionType) and isinstance(new, types.FunctionType)):
        return False
    if old.__code__.co_freevars == new.__code__.co_freevars and old.__module__ == new.__module__:
        old.__code__, old.__defaults__, old.__kwdefaults__ = new.__code__, new.__defaults__, new.__kwdefaults__
    return True


# ---- which tests reach a line ----------------------------------------------------------------------------------------


def lines_of_interest(tree: ast.Module, line: int) -> set[int] | None:
    """Return the lines whose execution shows a mutation of `line`: its statement, or what uses the value it sets.

    None where every test may show it: it is executed when the module is imported.
    """
    functions = [node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef) and _spans(node, line)]
    if functions:
        function = min(functions, key=_length)
        if line < function.body[0].lineno:
            return set(range(function.body[0].lineno, (function.end_lineno or 0) + 1))
        statements = [node for node in ast.walk(function) if isinstance(node, ast.stmt) and _spans(node, line)]
        innermost = min(statements, key=_length)
        body = getattr(innermost, "body", None)
        last = body[0].lineno - 1 if body else innermost.end_lineno or innermost.lineno
        return set(range(innermost.lineno, max(last, innermost.lineno) + 1))
    top = next(node for node in tree.body if _spans(node, line))
    if isinstance(top, ast.ClassDef):
        return None
    names = {node.id for node in ast.walk(top) if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store)}
    uses = [node.lineno for node in ast.walk(tree) if isinstance(node, ast.Name) and node.id in names]
    found = [lines_of_interest(tree, use) for use in uses if not _spans(top, use)]
    return None if not found or None in found else set().union(*(lines or set() for lines in found))


def _length(node: ast.stmt) -> int:
    return (node.end_lineno or node.lineno) - node.lineno


def _spans(node: ast.stmt, line: int) -> bool:
    first = min([node.lineno, *(d.lineno for d in getattr(node, "decorator_list", []))])
    return first <= line <= (node.end_lineno or node.lineno)


class Reach:
    """Pytest plugin that runs every test once and notes the lines it reaches, with its fixtures, and its time."""

    def __init__(self, module: str) -> None:
        import coverage

        self._module = sys.modules[_import_name(module)]
        self._path = str(ROOT / module)
        self._coverage = coverage.Coverage(data_file=None, config_file=False, include=[self._path])
        self._context = ""
        self.seconds: dict[str, float] = defaultdict(float)
        self.failed: list[str] = []

    def _switch(self, context: str) -> str:
        before, self._context = self._context, context
        self._coverage.switch_context(context)
        return before

    @pytest.hookimpl(hookwrapper=True)
    def pytest_fixture_setup(self, fixturedef: Any) -> Iterator[None]:
        before = self._switch(_fixture(fixturedef)) if fixturedef.scope != "function" else self._context
        yield
        self._switch(before)

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        self.seconds[report.nodeid] += report.duration
        if report.failed:
            self.failed.append(report.nodeid)

    def run(self, session: pytest.Session) -> dict[str, tuple[float, set[int]]]:
        """Return seconds and lines of each test."""
        self._coverage.start()
        for item, following in zip(session.items, [*session.items[1:], None], strict=True):
            self._switch(item.nodeid)
            for function in vars(self._module).values():
                if hasattr(function, "cache_clear"):  # what one test has had computed hides its lines from the next
                    function.cache_clear()
            item.ihook.pytest_runtest_protocol(item=item, nextitem=following)
        self._coverage.stop()
        lines: dict[str, set[int]] = defaultdict(set)
        for line, contexts in self._coverage.get_data().contexts_by_lineno(self._path).items():
            for context in contexts:
                lines[context].add(line)
        return {
            item.nodeid: (self.seconds[item.nodeid], lines[item.nodeid].union(*(lines[f] for f in _fixtures(item))))
            for item in session.items
            if item.nodeid not in self.failed
        }


def _fixture(definition: Any) -> str:
    return f"{definition.baseid}::fixture {definition.argname}"


def _fixtures(item: Any) -> set[str]:
    return {_fixture(one) for several in item._fixtureinfo.name2fixturedefs.values() for one in several}


# ---- running ---------------------------------------------------------------------------------------------------------


class Runner:
    """Pytest plugin that takes the place of the loop over tests: it tries the mutants, each in a fork."""

    def __init__(self, module: str, count: int | None) -> None:
        self._module, self._count = module, count
        self._path = ROOT / module
        self._stopping = False

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        if self._stopping and report.failed:
            os._exit(1)

    def pytest_runtestloop(self, session: pytest.Session) -> bool:
        source = self._path.read_text(encoding="utf-8")
        tree = ast.parse(source)
        reach: dict[str, tuple[float, set[int]]] = _in_fork(lambda: self._reach(session))
        items = {item.nodeid: item for item in session.items}
        store = Results(self._module, source, session.config.args)
        mutants = {store.key(mutant): mutant for mutant in islice(mutants_of(source), self._count)}
        store.whole = self._count is None
        store.found = {key: one for key, one in store.found.items() if key in mutants}
        for mutant in [mutant for key, mutant in mutants.items() if key not in store.found]:
            wanted = lines_of_interest(tree, mutant.line)
            tests = sorted(
                (seconds, test) for test, (seconds, lines) in reach.items() if wanted is None or wanted & lines
            )
            store.add(mutant, self._try(mutant, [items[test] for _, test in tests], sum(s for s, _ in tests)))
        store.save()
        return True

    def _reach(self, session: pytest.Session) -> dict[str, tuple[float, set[int]]]:
        plugin = Reach(self._module)
        session.config.pluginmanager.register(plugin)
        return plugin.run(session)

    def _try(self, mutant: Mutant, items: list[Any], seconds: float) -> str:
        """Return "killed", "timeout" or "survived"."""
        if not items:
            return "survived"
        pid = os.fork()
        if pid == 0:
            self._child(mutant, items, seconds)
        end_s = time.monotonic() + _LEAST_WALL_S + 10 * seconds
        while time.monotonic() < end_s:
            done, status = os.waitpid(pid, os.WNOHANG)
            if done:
                if os.WIFSIGNALED(status):
                    return "timeout"
                return "survived" if os.WEXITSTATUS(status) == 0 else "killed"
            time.sleep(0.01)
        with suppress(ProcessLookupError):
            os.killpg(pid, signal.SIGKILL)
        os.waitpid(pid, 0)
        return "timeout"

    def _child(self, mutant: Mutant, items: list[Any], seconds: float) -> None:
        code = 2
        try:
            os.setsid()
            limit = int(_LEAST_CPU_S + 5 * seconds)
            resource.setrlimit(resource.RLIMIT_CPU, (limit, limit))
            self._stopping = True
            replace_code(sys.modules[_import_name(self._module)], mutant.source)
            for item, following in zip(items, [*items[1:], None], strict=True):
                item.ihook.pytest_runtest_protocol(item=item, nextitem=following)
            code = 0
        finally:
            os._exit(code)


def _in_fork(compute: Callable[[], Any]) -> Any:
    """Return what a function returns, computed in a fork: this process stays as it is."""
    read, write = os.pipe()
    pid = os.fork()
    if pid == 0:
        with os.fdopen(write, "wb") as pipe:
            pickle.dump(compute(), pipe)
        os._exit(0)
    os.close(write)
    with os.fdopen(read, "rb") as pipe:
        content = pipe.read()
    os.waitpid(pid, 0)
    return pickle.loads(content)


def _import_name(module: str) -> str:
    return module.removesuffix(".py").replace("/", ".")


def results_file(module: str) -> Path:
    return FOLDER / (module.replace("/", "_") + ".json")


class Results:
    """The results of one module so far, in FOLDER."""

    def __init__(self, module: str, source: str, tests: list[str]) -> None:
        self._source, self._path = source.splitlines(), results_file(module)
        self._hash = hashlib.sha256(source.encode()).hexdigest()
        content = "".join(Path(ROOT / test).read_text(encoding="utf-8") for test in tests)
        self._state = hashlib.sha256((source + content).encode()).hexdigest()
        self.whole = False
        kept = self.kept(module)
        found = kept["found"].items() if kept["source"] == self._hash else ()
        # what was killed stays so while the source is the same; new tests try the others again
        same = kept["state"] == self._state
        self.found: dict[str, dict[str, Any]] = {k: one for k, one in found if same or one["outcome"] != "survived"}

    @staticmethod
    def kept(module: str) -> dict[str, Any]:
        """Return what is kept of a module: `found`, by mutant, and whether that is the `whole`."""
        path = results_file(module)
        nothing = {"source": "", "state": "", "whole": False, "found": {}}
        content: dict[str, Any] = json.loads(path.read_text(encoding="utf-8")) if path.exists() else nothing
        return content

    def key(self, mutant: Mutant) -> str:
        """Return what names a mutant."""
        return f"{mutant.operator}:{hashlib.sha256(mutant.source.encode()).hexdigest()[:16]}"

    def add(self, mutant: Mutant, outcome: str) -> None:
        """Keep a result."""
        line = self._source[mutant.line - 1].strip()
        self.found[self.key(mutant)] = {
            "outcome": outcome, "operator": mutant.operator, "line": mutant.line,
            "before": line, "after": mutant.change,
        }  # fmt: skip
        self.save()
        sys.__stderr__.write(f"{len(self.found)} {outcome:8} {mutant.line:4} {line}  ->  {mutant.change}\n")

    def save(self) -> None:
        """Write the file."""
        FOLDER.mkdir(parents=True, exist_ok=True)
        content = {"source": self._hash, "state": self._state, "whole": self.whole, "found": self.found}
        self._path.write_text(json.dumps(content, indent=1), encoding="utf-8")


def main(modules: list[str], count: int | None) -> None:
    """Try the mutants of modules, one after another; `count` of each, drawn at random, or all."""
    for module in modules:
        pid = os.fork()
        if pid == 0:
            if "@compiled" in (ROOT / module).read_text(encoding="utf-8"):  # machine code cannot be replaced
                os.environ["NUMBA_DISABLE_JIT"] = "1"
            arguments = [*MODULES[module], "-q", "-p", "no:cacheprovider", "-p", "no:xdist", "-m", "not nightly",
                         "-s", "--no-header", "-o", "timeout=0"]  # fmt: skip
            code = pytest.main(arguments, plugins=[Runner(module, count)])
            os._exit(int(code))
        os.waitpid(pid, 0)
    subprocess.run([sys.executable, "-m", "tests.mutation.scores"], cwd=ROOT, check=True)


if __name__ == "__main__":
    chosen = [name for name in sys.argv[1:] if not name.isdigit()]
    counts = [int(name) for name in sys.argv[1:] if name.isdigit()]
    main(chosen or list(MODULES), counts[0] if counts else None)
