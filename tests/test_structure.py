"""The shape of the house: layers, kernels, what is imported when, and what ships."""

import ast
import importlib
import re
import subprocess
import sys
from functools import cache
from pathlib import Path

import pytest

import crowdsim

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / "crowdsim"
MODULES = sorted(path for path in PACKAGE.rglob("*.py"))
# What nothing in the product refers to: the list of what a checkpoint must hold.
FOR_TESTS = {"STATE"}


@cache
def parsed(path: Path) -> ast.Module:
    return ast.parse(path.read_text(encoding="utf-8"))


def references(path: Path) -> set[str]:
    """Names that a file reads, strings that are a name among them."""
    found: set[str] = set()
    for node in ast.walk(parsed(path)):
        if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Load):
            found.add(node.id)
        elif isinstance(node, ast.Attribute) and isinstance(node.ctx, ast.Load):
            found.add(node.attr)
        elif isinstance(node, ast.Constant) and isinstance(node.value, str) and node.value.isidentifier():
            found.add(node.value)
    return found


def definitions(path: Path) -> set[str]:
    """Functions, classes and single constants at the top level of a file, but for commands."""
    found: set[str] = set()
    for node in parsed(path).body:
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            if not any(ast.unparse(item).startswith("app.") for item in node.decorator_list):
                found.add(node.name)
        elif isinstance(node, ast.Assign):
            found.update(target.id for target in node.targets if isinstance(target, ast.Name))
    return {name for name in found if not name.startswith("__")}


def imports(path: Path, everywhere: bool = True) -> set[str]:
    """Absolute names of the modules that a file imports, at its top level only unless ``everywhere``."""
    tree = parsed(path)
    nodes = ast.walk(tree) if everywhere else iter(tree.body)
    found: set[str] = set()
    for node in nodes:
        if isinstance(node, ast.Import):
            found.update(name.name for name in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: imports are absolute"
            found.add(node.module or "")
            found.update(f"{node.module}.{name.name}" for name in node.names)
    return found


def relative(path: Path) -> str:
    return path.relative_to(ROOT).as_posix()


def holds_kernels(path: Path) -> bool:
    """Kernels are in files whose names end so, in packages of that name, of reward terms and axes, and in core."""
    return (
        path.stem.endswith("kernels")
        or "kernels" in path.parts
        or path.parent.relative_to(PACKAGE).as_posix() in ("policy/terms", "policy/axes")
        or (path.parent.name == "core" and path.stem not in ("types", "workers"))
    )


PLAIN = {PACKAGE / name for name in ("jit.py", "core/types.py", "config/files.py", "errors.py", "policy/records.py")}
"""What kernels may import beside one another."""


def test_kernels_import_only_kernels_core_jit_and_what_numba_compiles() -> None:
    kernels = list(filter(holds_kernels, MODULES))
    assert kernels
    for path in kernels:
        names = {name for name in imports(path) if not name.startswith("crowdsim.")}
        allowed = {"collections", "numpy", "numba", "math", "typing", "__future__"}
        if path.parent.parent.name == "policy" and path.parent.name != "kernels":
            allowed |= {"dataclasses", "pydantic"}  # keys of recipes beside the kernels that give them their meaning
        assert {name.split(".")[0] for name in names} <= allowed, path
        for node in ast.walk(parsed(path)):
            if isinstance(node, ast.ImportFrom) and node.module and node.module.startswith("crowdsim."):
                source = ROOT.joinpath(*node.module.split(".")).with_suffix(".py")
                assert source in PLAIN or holds_kernels(source), f"{path}: {node.module}"


LIBRARY = {
    *("exp", "exp2", "expm1", "log", "log1p", "log2", "log10", "pow", "power", "cbrt", "hypot", "sin", "cos", "tan"),
    *("asin", "acos", "atan", "atan2", "arcsin", "arccos", "arctan", "arctan2", "sinh", "cosh", "tanh", "erf", "gamma"),
}
"""Functions whose last bits depend on the mathematical library; `core` has its own."""

NOT_ON_DEVICES = {"ceil", "floor", "rint", "round", "sqrt", "trunc"}
"""Functions of numpy that do not compile for GPUs; those of ``math`` do."""


def test_kernels_of_control_call_no_mathematical_library() -> None:
    control = [
        one for one in MODULES if relative(one).startswith(("crowdsim/crowd/kernels", "crowdsim/places/kernels"))
    ]
    assert control
    assert [(path, call) for path in control for call in library_calls(parsed(path))] == []


def test_what_kernels_of_control_call_calls_no_mathematical_library() -> None:
    called = [path for name in ("core", "policy/axes", "policy/terms") for path in (PACKAGE / name).glob("*.py")]
    kernels = [
        (path, node)
        for path in called
        if path.name != "quaternions.py"
        for node in ast.walk(parsed(path))
        if isinstance(node, ast.FunctionDef) and any("kernel" in ast.unparse(one) for one in node.decorator_list)
    ]
    assert kernels
    assert [(path, call) for path, node in kernels for call in library_calls(node)] == []
    assert not [one for one in MODULES if "crowd/kernels" in one.as_posix() and "quaternions" in one.read_text()]


def library_calls(tree: ast.AST) -> list[str]:
    """Return calls of ``LIBRARY`` and ``NOT_ON_DEVICES``, and powers that are no products."""
    calls = [node for node in ast.walk(tree) if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute)]
    powers = [node for node in ast.walk(tree) if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Pow)]
    found = [
        ast.unparse(node)
        for node in calls
        if isinstance(node.func, ast.Attribute)
        and (
            (node.func.attr in LIBRARY and ast.unparse(node.func.value) in ("math", "np", "numpy"))
            or (node.func.attr in NOT_ON_DEVICES and ast.unparse(node.func.value) in ("np", "numpy"))
        )
    ]
    return found + [
        ast.unparse(node)
        for node in powers
        if not isinstance(node.left, ast.Constant)
        and not (isinstance(node.right, ast.Constant) and node.right.value in (2, 3))
    ]


def test_only_kernels_are_compiled() -> None:
    decorators = [
        (relative(path), ast.unparse(item))
        for path in MODULES
        if not holds_kernels(path)
        for node in ast.walk(parsed(path))
        if isinstance(node, ast.FunctionDef)
        for item in node.decorator_list
    ]
    compiled = {one for one in decorators if one[1].split("(")[0] == "kernel" or "jit" in one[1]}
    # What threads of a GPU share, compiled for it alone.
    assert compiled == {("crowdsim/crowd/cuda/threads.py", "cuda.jit(device=True)")}


# What opens, lists, moves or removes files; inside folders of outputs only crowdsim.files does.
DOOR = {
    *("open", "os.open", "os.listdir", "os.scandir", "os.walk", "os.replace", "os.rename", "os.remove", "os.unlink"),
    *("os.rmdir", "os.mkdir", "os.makedirs", "os.link", "os.symlink", "shutil.rmtree", "shutil.move", "shutil.copy"),
    *("shutil.copyfile", "shutil.copytree"),
}
METHODS = {
    *("open", "unlink", "rename", "rmdir", "mkdir", "iterdir", "glob", "rglob", "read_text", "read_bytes", "touch"),
    *("write_text", "write_bytes", "symlink_to", "hardlink_to"),
}
# Each with the reason why it is no file inside a folder of outputs.
OTHER_WAYS = {
    "crowdsim/runs/archive.py: archive.open": "an entry of a ZIP file",
    "crowdsim/runs/archive.py: folder.mkdir": "a new temporary folder, into which it is unpacked",
    "crowdsim/runs/lock.py: os.open": "the folder itself, to lock it",
    "crowdsim/runs/lock.py: Path('/proc/sys/kernel/random/boot_id').read_text": "a file of the system",
    "crowdsim/runs/provenance.py: (package / name).rglob": "sources of the package",
    "crowdsim/runs/provenance.py: path.read_bytes": "sources of the package",
    "crowdsim/runs/opening.py: known.glob": "policies, which are found by name",
    "crowdsim/runs/recording.py: writer.open": "a take that begins",
    "crowdsim/take/store.py: self.open": "a take that begins",
    "crowdsim/batch/attempts.py: open": "a log that several processes add to, opened without following links",
    "crowdsim/batch/attempts.py: os.open": "likewise",
    "crowdsim/batch/description.py: Path(path).read_bytes": "a description, which a user names",
    "crowdsim/batch/description.py: path.read_bytes": "likewise",
    "crowdsim/batch/running.py: folder.iterdir": "the folder of the batch itself, to see whether it is one",
    "crowdsim/batch/running.py: folder.rmdir": "the folder of the batch itself, where nothing came of it",
    "crowdsim/batch/report.py: table.map(harmless_cell).rename": "columns of a table",
    "crowdsim/render/parts.py: path.rmdir": "the folder of a video's segments itself, where nothing else is in it",
    "crowdsim/runs/folder.py: folder.iterdir": "the run folder itself, to see whether it is one",
}


HOUSES = [
    path for name in ("runs", "take", "batch", "outputs", "play") for path in sorted((PACKAGE / name).glob("*.py"))
]
HOUSES += [PACKAGE / name for name in ("export/posed.py", "export/stream.py", "render/batch.py", "render/parts.py")]


def test_files_inside_folders_of_outputs_are_touched_by_one_module_alone() -> None:
    found = set()
    for path in HOUSES:
        for node in ast.walk(parsed(path)):
            if isinstance(node, ast.Call):
                name = ast.unparse(node.func)
                if name in DOOR or (isinstance(node.func, ast.Attribute) and node.func.attr in METHODS and "." in name):
                    found.add(f"{relative(path)}: {name}")
    assert found <= set(OTHER_WAYS)


def test_kernels_that_call_what_creates_arrays_say_so() -> None:
    # numba takes over from the first caller whether references are counted, so that it would depend on the order.
    kernels: dict[tuple[str, str], tuple[str, set[tuple[str, str]]]] = {}
    for path in MODULES:
        module = ".".join(path.relative_to(ROOT).with_suffix("").parts)
        known = {
            alias.asname or alias.name: (node.module, alias.name)
            for node in parsed(path).body
            if isinstance(node, ast.ImportFrom) and node.module
            for alias in node.names
        }
        for node in parsed(path).body:
            said = [ast.unparse(one) for one in node.decorator_list] if isinstance(node, ast.FunctionDef) else []
            if any(re.match(r"kernel\b", one) for one in said):
                called = {
                    one.func.id for one in ast.walk(node) if isinstance(one, ast.Call) and hasattr(one.func, "id")
                }
                kernels[module, node.name] = said[0], {known.get(name, (module, name)) for name in called}
    creates = {which for which, (said, _) in kernels.items() if "allocates=True" in said}
    assert len(creates) > 20
    assert {which for which, (_, called) in kernels.items() if called & creates} <= creates


def test_only_point_clouds_import_open3d() -> None:
    def importing(names: set[str], everywhere: bool) -> set[str]:
        found = {path: {name.split(".")[0] for name in imports(path, everywhere)} for path in MODULES}
        return {relative(path) for path, imported in found.items() if imported & names}

    assert importing({"open3d"}, everywhere=True) <= {"crowdsim/export/cloud_files.py"}
    assert importing({"open3d", "pickle"}, everywhere=False) == set()


def test_help_loads_neither_numba_nor_open3d() -> None:
    program = (
        "import sys; sys.argv = ['crowdsim', '--help']\n"
        "from crowdsim.cli import main\n"
        "try:\n    main()\nexcept SystemExit as leave:\n    assert not leave.code, leave.code\n"
        "heavy = {'numba', 'open3d', 'scipy', 'matplotlib', 'zarr'} & set(sys.modules)\n"
        "assert not heavy, heavy\n"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stderr
    assert "inspect" in done.stdout


def test_every_module_imports_and_every_public_name_exists() -> None:
    for path in MODULES:
        dotted = ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")
        module = importlib.import_module(dotted)
        assert module.__doc__, path
        for name in getattr(module, "__all__", []):
            assert getattr(module, name) is not None, f"{path}: {name}"


def test_an_unknown_name_of_the_package_is_refused_with_those_it_has() -> None:
    with pytest.raises(AttributeError, match="has no attribute 'boxer'; it has __version__"):
        _ = crowdsim.boxer


def test_nothing_is_kept_for_tests_alone() -> None:
    tools = [path for folder in ("benchmarks", "docs", "release") for path in (ROOT / folder).rglob("*.py")]
    used = set().union(*map(references, [*MODULES, *tools]))
    unused = {f"{relative(path)}: {name}" for path in MODULES for name in definitions(path) - used - FOR_TESTS}
    assert not unused


def test_every_marker_of_tests_marks_some() -> None:
    text = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
    declared = re.findall(r'^    "(\w+): ', text.split("markers = [")[1].split("]")[0], re.MULTILINE)
    tests = "".join(path.read_text(encoding="utf-8") for path in (ROOT / "tests").rglob("test_*.py"))
    assert declared
    assert [name for name in declared if f"pytest.mark.{name}" not in tests] == []


def test_scenarios_and_policies_ship_inside_the_wheel() -> None:
    text = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
    assert '"crowdsim.scenarios" = "scenarios"' in text
    assert '"crowdsim.policies" = "policies"' in text


def test_every_package_ships_inside_the_wheel() -> None:
    text = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
    for path in PACKAGE.rglob("__init__.py"):
        assert f'"{".".join(path.parent.relative_to(ROOT).parts)}"' in text


def test_what_readme_opens_takes_with_is_installed_with_the_package() -> None:
    needed = (ROOT / "pyproject.toml").read_text(encoding="utf-8").split("[project.optional-dependencies]")[0]
    assert "xarray.open_zarr" in (ROOT / "README.md").read_text(encoding="utf-8")
    assert '"xarray>=' in needed
