"""Reading and writing files so that nothing is lost: whole or not at all, bounded, with one clear error."""

from p3dof._base.files.archives import MAX_TEXT, UnfitError, pack_arrays, unpack_arrays
from p3dof._base.files.csv_text import write_table
from p3dof._base.files.generated import check_generated, differences, write_generated
from p3dof._base.files.json_text import dump_hashed, hash_of, parse_hashed, parse_json
from p3dof._base.files.kinds import SUFFIXES, suffix_of
from p3dof._base.files.reading import MAX_BYTES, Source, called, is_stream, read_bytes, read_text, reason
from p3dof._base.files.temporary import scratch_folder
from p3dof._base.files.writing import check_writable, make_folders, together, write_atomic, write_streamed
from p3dof._base.files.yaml_text import MAX_YAML, parse_yaml

__all__ = [
    "MAX_BYTES",
    "MAX_TEXT",
    "MAX_YAML",
    "SUFFIXES",
    "Source",
    "UnfitError",
    "called",
    "check_generated",
    "check_writable",
    "differences",
    "dump_hashed",
    "hash_of",
    "is_stream",
    "make_folders",
    "pack_arrays",
    "parse_hashed",
    "parse_json",
    "parse_yaml",
    "read_bytes",
    "read_text",
    "reason",
    "scratch_folder",
    "suffix_of",
    "together",
    "unpack_arrays",
    "write_atomic",
    "write_generated",
    "write_streamed",
    "write_table",
]
