"""Do the unit tests notice a broken formula?  Each mutant is one: a sign, an operator, a factor, a function or a comparison is another.

A copy of the tree is broken in one place at a time and the unit tests of the broken module alone are run on it, uncompiled.  Which places:
drawn by ``--seed`` from all there are, in proportion.  What no test noticed is listed.
"""

import ast
import json
import os
import random
import shutil
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest
import scipy.optimize  # loaded once, for all that are forked
import scipy.stats  # noqa: F401
from common import run

ROOT = Path(__file__).resolve().parents[1]
TESTS = {
    "physics/strapdown.py": ["strapdown"],
    "physics/stochastic.py": ["stochastic"],
    "physics/attitude_propagation.py": ["attitude_kernels"],
    "physics/magnetic_heading.py": ["magnetic_heading"],
    "cores/inertial.py": ["inertial"],
    "cores/headings.py": ["heading_cells"],
    "cores/reckoning_model.py": ["dead_reckoning_model"],
    "estimation/kalman.py": ["kalman"],
    "estimation/attitude_vectors.py": ["attitude_kernels"],
    "aids/dme.py": ["station_aid"],
    "aids/vor.py": ["vor_aid"],
    "calibration/allan.py": ["allan"],
    "calibration/identification.py": ["identify"],
    "calibration/temperature.py": ["identify"],
    "calibration/heading_error.py": ["calibration_heading"],
    "calibration/magnetometer_swing.py": ["calibration_heading"],
    "calibration/magnetometer_two_step.py": ["calibration_magnetometer"],
    "calibration/magnetometer_batch.py": ["calibration_magnetometer"],
}
"""The unit tests of each module that is broken."""
SWAPS = {ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.Div, ast.Div: ast.Mult}
NAMES = {"sin": "cos", "cos": "sin", "max": "min", "min": "max", "exp": "expm1", "ceil": "floor", "floor": "ceil"}
ORDERS = {ast.Lt: ast.Gt, ast.Gt: ast.Lt, ast.LtE: ast.GtE, ast.GtE: ast.LtE}
LONGEST_S = 300.0


def places(tree: ast.Module) -> Iterator[tuple[ast.AST, str]]:
    """Nodes inside functions that can be broken, and the kind of break."""
    for function in (node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)):
        for node in ast.walk(function):
            if isinstance(node, ast.BinOp | ast.AugAssign) and type(node.op) in SWAPS and not _is_text(node):
                yield node, "operator"
            elif isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub) and not isinstance(node.operand, ast.Constant):
                yield node, "sign"
            elif isinstance(node, ast.Constant) and isinstance(node.value, float) and node.value not in (0.0, 1.0):
                yield node, "factor"
            elif isinstance(node, ast.Attribute) and node.attr in NAMES and getattr(node.value, "id", "") in ("np", "math"):
                yield node, "function"
            elif isinstance(node, ast.Compare) and type(node.ops[0]) in ORDERS:
                yield node, "comparison"


def _is_text(node: ast.AST) -> bool:
    return any(
        isinstance(part, ast.JoinedStr) or (isinstance(part, ast.Constant) and isinstance(part.value, str)) for part in ast.walk(node)
    )


def broken(source: str, index: int) -> tuple[str, str]:
    """Source with the place of this index broken, and what was done, for people."""
    tree = ast.parse(source)
    node, kind = list(places(tree))[index]
    before = ast.unparse(node)
    if isinstance(node, ast.BinOp | ast.AugAssign):
        node.op = SWAPS[type(node.op)]()
    elif isinstance(node, ast.UnaryOp):
        node.op = ast.UAdd()
    elif isinstance(node, ast.Constant):
        node.value *= 2.0
    elif isinstance(node, ast.Attribute):
        node.attr = NAMES[node.attr]
    elif isinstance(node, ast.Compare):
        node.ops[0] = ORDERS[type(node.ops[0])]()
    return ast.unparse(tree), f"{node.lineno}: {kind}: {before[:70]} -> {ast.unparse(node)[:70]}"


class Durations:
    """How long each test took, the quickest first: most breaks are noticed by a quick one."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """Of each part of each test; called by pytest."""
        self.seconds[report.nodeid] = self.seconds.get(report.nodeid, 0.0) + report.duration

    @property
    def tests(self) -> list[str]:
        """The tests in order."""
        return sorted(self.seconds, key=self.seconds.__getitem__)


def passing(tree: Path, tests: list[str]) -> list[str] | None:
    """Tests of a tree, the quickest first; None where one fails or does not end.  A fork runs them: libraries are loaded once."""
    said = tree.parent / f"{tree.name}.json"
    child = os.fork()
    if not child:
        os.chdir(tree)
        os.environ["LOWCOSTNAV_KERNELS"], sys.dont_write_bytecode = "interpreted", True
        sys.path.insert(0, str(tree))
        for name in [name for name in sys.modules if name.partition(".")[0] == "lowcostnav_ros"]:
            del sys.modules[name]
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
        os.dup2(1, 2)
        took = Durations()
        failed = pytest.main(["-q", "-x", "-p", "no:cacheprovider", "-p", "no:xdist", f"--timeout={LONGEST_S:.0f}", *tests], [took])
        said.write_text(json.dumps(took.tests))
        os._exit(min(int(failed), 1))
    _, status = os.waitpid(child, 0)
    return json.loads(said.read_text()) if status == 0 else None


def measure(options) -> dict:
    """Break, test, count."""
    count, draw = options.count or (20 if options.quick else 200), random.Random(options.seed)
    chosen = [name for name in TESTS if options.module in name]
    sources = {name: (ROOT / "lowcostnav_ros" / name).read_text(encoding="utf-8") for name in chosen}
    every = [(name, k) for name, source in sources.items() for k in range(len(list(places(ast.parse(source)))))]
    survivors, total = [], min(count, len(every))
    with tempfile.TemporaryDirectory() as folder:
        tree = Path(folder)
        for part in ("lowcostnav_ros", "test"):
            shutil.copytree(ROOT / part, tree / part, ignore=shutil.ignore_patterns("__pycache__"))
        for part in (p for p in ROOT.iterdir() if not (tree / p.name).exists() and not p.name.startswith(".")):
            (tree / part.name).symlink_to(part)
        tests: dict[str, list[str] | None] = {}
        for name, k in sorted(draw.sample(every, total)):
            if name not in tests:
                tests[name] = passing(tree, [f"test/test_{part}.py" for part in TESTS[name]])
            if tests[name] is None:
                raise SystemExit(f"The tests of {name} fail on the tree as it is.")
            text, what = broken(sources[name], k)
            path = tree / "lowcostnav_ros" / name
            path.write_text(text, encoding="utf-8")
            caught = passing(tree, tests[name]) is None
            print("caught  " if caught else "SURVIVED", f"{name}:{what}", flush=True)
            if not caught:
                survivors.append(f"{name}:{what}")
            path.write_text(sources[name], encoding="utf-8")
    return {"mutants": total, "of": len(every), "caught": total - len(survivors), "survivors": survivors}


if __name__ == "__main__":
    run(
        __doc__,
        measure,
        count={"type": int, "default": 0, "help": "how many mutants (default: 200, 20 with --quick)"},
        seed={"type": int, "default": 1, "help": "which of them"},
        module={"default": "", "help": "only modules with this in their path"},
    )
