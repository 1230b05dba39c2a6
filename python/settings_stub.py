"""Writes the settings of an environment as a TypedDict, for type checkers: settings_stub.py FILE"""
import sys

import _core

TYPES = {"integer": "int", "number": "float", "number or none": "float | None", "integer or none": "int | None",
         "integer, or two such as 0-8": "int | tuple[int, int] | str", "true/false": "bool", "text": "str"}
GIVEN_APART = ("game", "num_envs")  # arguments of their own

with open(sys.argv[1], "w", encoding="utf-8") as stub:
    stub.write("import os\nfrom typing import Literal, TypedDict\n\n"
               "class Settings(TypedDict, total=False):\n"
               '    """The settings of an environment, each with its sentence."""\n\n')
    for setting in _core.settings():
        if setting["name"] in GIVEN_APART:
            continue
        choices = ", ".join(f'"{choice}"' for choice in setting["choices"])
        kind = f"Literal[{choices}]" if choices else TYPES[setting["type"]]
        if setting["name"] == "rom_dir":
            kind = "str | os.PathLike[str] | None"
        within = f" ({setting['range']})" if setting["range"] else ""
        stub.write(f"    {setting['name']}: {kind}\n    \"\"\"{setting['help']}{within}\"\"\"\n")
