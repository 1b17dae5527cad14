"""What type checkers are told is what the package has."""

import ast
import pathlib

import esaac

STUB = pathlib.Path(esaac.__file__).with_name("__init__.pyi")
USE = pathlib.Path(__file__).with_name("typed_use.py")


def test_the_stub_lists_the_parameters_of_a_sensor_with_their_types():
    classes = {node.name: node for node in ast.parse(STUB.read_text()).body if isinstance(node, ast.ClassDef)}
    told = [node for node in classes["SensorModel"].body if isinstance(node, ast.AnnAssign)]
    sensor = esaac.SensorModel()
    parameters = [name for name, _, _ in esaac.SensorModel.parameters()]
    assert [(node.target.id, node.annotation.id) for node in told] == [
        (name, type(getattr(sensor, name)).__name__) for name in parameters
    ]


def test_the_typed_program_uses_every_name_of_the_package():
    used = {
        node.attr
        for node in ast.walk(ast.parse(USE.read_text()))
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id == "esaac"
    }
    assert sorted(set(esaac.__all__) - used) == []
