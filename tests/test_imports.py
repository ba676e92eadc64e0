"""The direction of imports, read from the source: shaders ← renderer ← fitter."""

from __future__ import annotations

import ast
import graphlib
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = ("shaders", "renderer", "fitter")  # each may import itself and those before it
FILES = {
    ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__"): path
    for package in PACKAGES
    for path in sorted((ROOT / package).rglob("*.py"))
}
SOLVERS = {"jax", "optimistix", "lineax", "equinox"}


def imported(name: str, *, at_start: bool = False) -> set[str]:
    """Modules that module `name` imports: all of them, or only those without which it cannot be loaded."""
    tree = ast.parse(FILES[name].read_text("utf-8"))
    nodes = list(_run_at_start(tree) if at_start else ast.walk(tree))
    plain = {alias.name for node in nodes if isinstance(node, ast.Import) for alias in node.names}
    return plain.union(*(_from(node, name) for node in nodes if isinstance(node, ast.ImportFrom)))


def _from(node: ast.ImportFrom, importer: str) -> set[str]:
    assert node.level == 0, f"{importer} imports relatively, in line {node.lineno}"
    assert node.module is not None
    submodules = {f"{node.module}.{alias.name}" for alias in node.names} & FILES.keys()
    return submodules or {node.module}


def _run_at_start(tree: ast.AST):
    """Every node outside of functions and of `if TYPE_CHECKING`."""
    for node in ast.iter_child_nodes(tree):
        lazy = isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda)
        if lazy or (isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING"):
            continue
        yield node
        yield from _run_at_start(node)


def top(modules: set[str]) -> set[str]:
    """The packages that modules belong to."""
    return {module.partition(".")[0] for module in modules}


def test_there_is_something_to_look_at():
    assert {
        "fit_material.shaders.optics.fresnel",
        "fit_material.renderer.scene.scene_file",
        "fit_material.fitter.commands.app",
        "fitter",
    } <= FILES.keys()
    assert imported("fit_material.fitter.commands.app", at_start=True) < imported(
        "fit_material.fitter.commands.app"
    )  # it imports late, which is seen too


@pytest.mark.parametrize("package", PACKAGES)
def test_imports_go_one_way(package):
    later = set(PACKAGES[PACKAGES.index(package) + 1 :]) | {"tests", "examples"}
    wrong = {name: found for name in FILES if top({name}) == {package} and (found := top(imported(name)) & later)}
    assert not wrong


def test_shading_is_pure_torch():
    """No files, no devices, no other library: pure functions of tensors."""
    allowed = {"torch", "jaxtyping", "shaders", *sys.stdlib_module_names} - {"os", "pathlib", "io"}
    wrong = {name: found for name in FILES if name.startswith("shaders") and (found := top(imported(name)) - allowed)}
    assert not wrong


def test_jax_stays_in_bridge_and_solver():
    assert {name for name in FILES if top(imported(name)) & SOLVERS} == {
        "fit_material.fitter.least_squares.jax_bridge",
        "fit_material.fitter.least_squares.solvers",
    }


def test_only_the_bridge_needs_torch_and_jax_to_be_loaded():
    """The solver that JAX has is fetched when it is called; Adam and L-BFGS do without."""
    both = {name for name in FILES if "torch" in (found := top(imported(name, at_start=True))) and found & SOLVERS}
    assert both == {"fit_material.fitter.least_squares.jax_bridge"}


def test_no_module_needs_itself_to_be_loaded():
    graph = {name: imported(name, at_start=True) & FILES.keys() for name in FILES}
    order = list(graphlib.TopologicalSorter(graph).static_order())  # raises CycleError, which names the modules
    assert all(order.index(needed) < order.index(name) for name, found in graph.items() for needed in found)


@pytest.mark.parametrize("library", ["torch", "jax", "mitsuba"])
def test_the_command_line_imports_heavy_libraries_late(library):
    """Whatever `fitter.commands.app` imports at its start, however deep, is without them."""
    seen, open_ = set(), ["fit_material.fitter.commands.app"]
    while open_:
        name = open_.pop()
        seen.add(name)
        found = imported(name, at_start=True)
        assert library not in top(found), name
        open_ += [other for other in found & FILES.keys() if other not in seen]
