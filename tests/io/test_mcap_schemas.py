"""The committed protobuf modules say what data_schemas says."""

import importlib.util
from importlib import import_module
from pathlib import Path

import pytest
from google.protobuf.descriptor_pb2 import DescriptorProto, FileDescriptorProto, FileDescriptorSet

ROOT = Path(__file__).parents[2]
PROTOS = sorted(path.stem for path in (ROOT / "data_schemas" / "vip_factors").glob("*.proto"))


def plain(proto: FileDescriptorProto) -> FileDescriptorProto:
    """Without the JSON names that protoc adds only to descriptor sets."""

    def strip(message: DescriptorProto) -> None:
        for member in message.field:
            member.ClearField("json_name")
        for nested in message.nested_type:
            strip(nested)

    for message in proto.message_type:
        strip(message)
    return proto


def test_the_modules_agree_with_the_schemas(tmp_path: Path) -> None:
    pytest.importorskip("grpc_tools", reason="regenerating the schemas needs grpcio-tools (extra dev)")
    spec = importlib.util.spec_from_file_location("generate", ROOT / "data_schemas" / "generate.py")
    assert spec is not None
    assert spec.loader is not None
    generate = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(generate)
    generate.run_protoc(f"--descriptor_set_out={tmp_path / 'all.bin'}")
    read = FileDescriptorSet.FromString((tmp_path / "all.bin").read_bytes())
    declared = {Path(one.name).stem: plain(one) for one in read.file}
    assert sorted(declared) == PROTOS
    for name, expected in declared.items():
        committed = FileDescriptorProto()
        import_module(f"vip_factors.io.schemas.{name}_pb2").DESCRIPTOR.CopyToProto(committed)
        assert plain(committed) == expected, f"{name}: run python data_schemas/generate.py"


def test_there_is_a_module_for_every_schema_and_no_other() -> None:
    modules = (ROOT / "vip_factors" / "io" / "schemas").glob("*_pb2.py")
    assert sorted(path.name.removesuffix("_pb2.py") for path in modules) == PROTOS
