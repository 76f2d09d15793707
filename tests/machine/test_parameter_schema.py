"""The JSON Schema of the parameter file and `read_parameters` accept and refuse the same files."""

import jsonschema
import pytest
import yaml
from parameter_files import ACCEPTED, REFUSED, SCHEMA, VALIDATOR

import p3dof


@pytest.mark.parametrize("data", ACCEPTED.values(), ids=ACCEPTED)
def test_both_accept(data, tmp_path):
    VALIDATOR.validate(data)
    (tmp_path / "machine.yaml").write_text(yaml.safe_dump(data), encoding="utf-8")
    p3dof.read_parameters(tmp_path / "machine.yaml")


@pytest.mark.parametrize("data", REFUSED.values(), ids=REFUSED)
def test_both_refuse(data, tmp_path):
    assert not VALIDATOR.is_valid(data)
    (tmp_path / "machine.yaml").write_text(yaml.safe_dump(data), encoding="utf-8")
    with pytest.raises(p3dof.errors.ParameterError):
        p3dof.read_parameters(tmp_path / "machine.yaml")


def test_what_is_written_is_accepted(tmp_path):
    for machine in (p3dof.PAPER, p3dof.SOLIDS):
        p3dof.write_parameters(machine, tmp_path / "machine.yaml")
        VALIDATOR.validate(yaml.safe_load((tmp_path / "machine.yaml").read_text(encoding="utf-8")))


def test_the_schema_is_one():
    jsonschema.Draft202012Validator.check_schema(SCHEMA)
