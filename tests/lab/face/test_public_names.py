"""All public names of `import eimi_lab as eimi` can be used, and their modules are loaded only when they are used."""

from __future__ import annotations

import inspect
import re
import subprocess
import sys

import pytest
import typer

import eimi_lab as eimi
from eimi_lab.cli import app

IMPORT_ALL = """
import importlib, inspect, pkgutil
import eimi_lab as eimi
for module in pkgutil.walk_packages(eimi.__path__, "eimi_lab."):
    if not module.name.endswith("__main__"):
        importlib.import_module(module.name)
print(*(name for name in eimi.__all__ if inspect.ismodule(getattr(eimi, name))))
print(*(name for name in eimi.__all__ if getattr(eimi, name) is None))
"""


def loaded_by(statement: str) -> set[str]:
    # Return the names of the modules that a new interpreter has loaded after a statement.
    words = f"import sys\n{statement}\nprint(*sys.modules)"
    result = subprocess.run([sys.executable, "-c", words], capture_output=True, text=True, check=True)
    return set(result.stdout.split())


def test_no_submodule_hides_a_name():
    result = subprocess.run([sys.executable, "-c", IMPORT_ALL], capture_output=True, text=True, check=True)
    assert result.stdout.split() == []


def test_an_import_loads_only_the_requested_modules():
    assert not {"numpy", "scipy", "cma", "h5py", "cv2", "pydantic", "matplotlib"} & loaded_by("import eimi_lab")
    assert not {"cma", "matplotlib", "typer"} & loaded_by("import eimi_lab\neimi_lab.open")


FUNCTIONS = [name for name in eimi.__all__ if inspect.isfunction(getattr(eimi, name))]


@pytest.mark.parametrize("name", FUNCTIONS)
def test_every_function_documents_each_of_its_parameters(name):
    function = getattr(eimi, name)
    written = inspect.getdoc(function) or ""
    head = re.findall(r"^(\w[\w, ]*?)(?: : .*)?$", written, re.M)
    documented = {one.strip() for line in head for one in line.split(",")}
    assert set(inspect.signature(function).parameters) <= documented
    for section in ("Parameters\n----------", "Returns\n-------", "Raises\n------"):
        assert section in written


# The defaults of some options depend on the command line: they are None there, and are replaced later.
REPLACED = {("fit", "seed"), ("report", "workers"), ("tensile", "window")}


def test_an_option_has_the_same_default_in_python_and_on_the_command_line():
    commands = typer.main.get_command(app).commands
    compared = set()
    for name in FUNCTIONS:
        command = commands.get("import" if name.startswith("import_") else name)
        options = {option.name: option for option in command.params if not option.required} if command else {}
        for parameter in inspect.signature(getattr(eimi, name)).parameters.values():
            if parameter.name in options and parameter.default is not parameter.empty:
                default = options[parameter.name].default
                if (name, parameter.name) not in REPLACED:
                    assert (parameter.default or None) == (default or None), (name, parameter.name)
                    compared.add((name, parameter.name))
    assert {name for name, _ in compared} >= {"acquire", "discover", "fit", "plan", "segment", "simulate", "validate"}
    assert len(compared) > 80


def test_every_class_of_a_result_is_public():
    for name in FUNCTIONS:
        result = inspect.signature(inspect.unwrap(getattr(eimi, name))).return_annotation
        classes = set(result.split(" | ")) - {"str"}
        assert classes <= set(eimi.__all__), name


def test_dir_lists_the_public_names_and_the_package_has_a_version():
    assert set(eimi.__all__) <= set(dir(eimi))
    assert re.match(r"\d+\.\d+", eimi.__version__)


def test_a_wrong_name_is_an_error_with_a_suggestion():
    with pytest.raises(AttributeError, match=r"module 'eimi_lab' has no attribute 'aquire'; did you mean 'acquire'\?"):
        eimi.aquire  # noqa: B018
    with pytest.raises(KeyError) as raised:
        eimi.LAWS["yeo"]
    assert str(raised.value) == "there is no law 'yeo'; did you mean 'yeoh'?"
    with pytest.raises(eimi.InputError, match=r"there is no law 'neo-hooke'; did you mean 'neo-hookean'\?"):
        eimi.fit("run.h5", "neo-hooke")
    with pytest.raises(TypeError, match=r"fit\(\) has no option 'tensil'; did you mean 'tensile'\?"):
        eimi.fit("run.h5", "yeoh", tensil="curve.csv")
    with pytest.raises(eimi.InputError, match=r"there is no such section; did you mean 'plane-stress'\?"):
        eimi.fit("run.h5", "yeoh", section="plane-stess")
    with pytest.raises(eimi.InputError, match=r"yeoh has no parameter 'c10'; did you mean 'C10'\?"):
        eimi.fit("run.h5", "yeoh", prior=eimi.Prior("c10", 1e4, 1e2))
    with pytest.raises(eimi.InputError, match=r"yeoh has no parameter 'C11'; did you mean 'C10'\?"):
        eimi.simulate("dragon_skin_10", "type1", "yeoh", parameter={"C11": 1.0})
