"""The direction of imports, read from the source: one way between folders, shaders ← renderer ← fitter."""

from __future__ import annotations

import ast
import graphlib
import sys

import pytest

from tests.support.paths import ROOT

PACKAGE = "fit_material"
FOLDERS = [  # lowest first: each may import itself and those before it
    "shaders.registry",
    "shaders.glsl",
    "shaders.optics",
    "shaders.materials",
    "shaders",
    "renderer.errors",
    "renderer.compute",
    "renderer.files",
    "renderer.backends",
    "renderer",
    "renderer.geometry",
    "renderer.cameras",
    "renderer.images",
    "renderer.camera_files",
    "renderer.environment",
    "renderer.materials",
    "renderer.scene",
    "renderer.photographs",
    "renderer.mitsuba",
    "renderer.rays",
    "renderer.light_sampling",
    "renderer.light_kernel",
    "renderer.light_tables",
    "renderer.path_tracing",
    "renderer.light_probe",
    "renderer.viewer_model",
    "renderer.opengl",
    "renderer.synthesis",
    "renderer.viewer",
    "fitter.html",
    "fitter.options",
    "fitter.command_line",
    "fitter.result",
    "fitter.export",
    "fitter.observations",
    "fitter.forward",
    "fitter.materials",
    "fitter.least_squares",
    "fitter.estimation",
    "fitter.frontier",
    "fitter.effects",
    "fitter.input_checks",
    "fitter.poses",
    "fitter.uncertainty",
    "fitter.metal_prior",
    "fitter.fitted",
    "fitter.report",
    "fitter.selftest.experiments",
    "fitter.selftest",
    "fitter.textures",
    "fitter.pipeline",
    "fitter.batch.workers",
    "fitter.batch",
    "fitter.next_view",
    "fitter.commands",
    "fitter",
]
MOST_FILES = 14  # in a folder
FILES = {
    ".".join((PACKAGE, *path.relative_to(ROOT).with_suffix("").parts)).removesuffix(".__init__"): path
    for top in ("shaders", "renderer", "fitter")
    for path in sorted((ROOT / top).rglob("*.py"))
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
    """The installed packages that modules belong to."""
    return {module.partition(".")[0] for module in modules}


def folder(name: str) -> str:
    """The folder of a module of ours, as the table names it."""
    package = name if FILES[name].name == "__init__.py" else name.rpartition(".")[0]
    return package.removeprefix(f"{PACKAGE}.")


def test_there_is_something_to_look_at():
    app = f"{PACKAGE}.fitter.commands.app"
    assert {f"{PACKAGE}.shaders.optics.fresnel", f"{PACKAGE}.renderer.scene.scene_file", app} <= FILES.keys()
    assert imported(app, at_start=True) < imported(app)  # it imports late, which is seen too


def test_the_table_lists_every_folder_once():
    assert sorted(FOLDERS) == sorted({folder(name) for name in FILES})


@pytest.mark.parametrize("name", FOLDERS)
def test_imports_between_folders_go_one_way(name):
    """Also those of types alone, and those inside functions."""
    later = set(FOLDERS[FOLDERS.index(name) + 1 :])
    own = [module for module in FILES if folder(module) == name]
    found = {(module, other) for module in own for other in imported(module) & FILES.keys() if folder(other) in later}
    assert not found
    assert not top(set().union(*map(imported, own))) & {"tests", "examples", "shaders", "renderer", "fitter"}


@pytest.mark.parametrize("name", FOLDERS)
def test_a_folder_is_small_and_its_first_line_says_what_it_holds(name):
    path = ROOT / name.replace(".", "/")
    assert len(list(path.glob("*.py"))) <= MOST_FILES
    assert (ast.get_docstring(ast.parse((path / "__init__.py").read_text("utf-8"))) or "").endswith(".")


def test_shading_is_pure_torch():
    """No files, no devices, no other library: pure functions of tensors."""
    allowed = {"torch", "jaxtyping", PACKAGE, *sys.stdlib_module_names} - {"os", "pathlib", "io"}
    shading = [name for name in FILES if folder(name).startswith("shaders")]
    assert not {name: found for name in shading if (found := top(imported(name)) - allowed)}


def test_jax_stays_in_bridge_and_solver():
    where = f"{PACKAGE}.fitter.least_squares"
    assert {name for name in FILES if top(imported(name)) & SOLVERS} == {f"{where}.jax_bridge", f"{where}.solvers"}


def test_only_the_bridge_needs_torch_and_jax_to_be_loaded():
    """The solver that JAX has is fetched when it is called; Adam and L-BFGS do without."""
    both = {name for name in FILES if "torch" in (found := top(imported(name, at_start=True))) and found & SOLVERS}
    assert both == {f"{PACKAGE}.fitter.least_squares.jax_bridge"}


def test_no_module_needs_itself():
    """No circle, not even of imports for types or inside functions."""
    graph = {name: imported(name) & FILES.keys() - {name} for name in FILES}
    order = list(graphlib.TopologicalSorter(graph).static_order())  # raises CycleError, which names the modules
    assert all(order.index(needed) < order.index(name) for name, found in graph.items() for needed in found)


@pytest.mark.parametrize("library", ["torch", "jax", "mitsuba"])
def test_the_command_line_imports_heavy_libraries_late(library):
    """Whatever `fitter.commands.app` imports at its start, however deep, is without them."""
    seen, open_ = set(), [f"{PACKAGE}.fitter.commands.app"]
    while open_:
        name = open_.pop()
        seen.add(name)
        found = imported(name, at_start=True)
        assert library not in top(found), name
        open_ += [other for other in found & FILES.keys() if other not in seen]
