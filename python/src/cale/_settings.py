"""The settings of an environment, by name: the table that YAML files and the command line read too."""

from __future__ import annotations

import importlib.util
import inspect
import os
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from cale import _core

_Function = TypeVar("_Function", bound=Callable[..., Any])


def settings() -> list[dict[str, Any]]:
    """Returns the settings of an environment: name, default, type, range, choices and a sentence of each."""
    return _core.settings()


def games() -> list[dict[str, Any]]:
    """Returns the games: names, and the scores of random play and of people that are published."""
    return _core.games()


def text_of(name: str, value: Any) -> str:
    """Returns the value of a setting as text, which is what the table reads."""
    if hasattr(value, "item") and getattr(value, "ndim", 0) == 0:
        value = value.item()  # a number of NumPy's
    if isinstance(value, bool):
        return "true" if value else "false"
    if value is None:
        return "none"
    if isinstance(value, os.PathLike):
        return require_utf8(name, os.fspath(value))
    if isinstance(value, (str, int, float)):
        return require_utf8(name, str(value))
    if isinstance(value, (tuple, list)) and value and all(isinstance(part, (int, np.integer)) for part in value):
        return "-".join(str(part) for part in value)
    if isinstance(value, (tuple, list)) and value and all(isinstance(part, str) for part in value):
        return require_utf8(name, ",".join(value))
    raise TypeError(f"{name} is a {type(value).__name__}, which is no value of a setting")


def require_utf8(name: str, text: str) -> str:
    """Returns the text. Refuses one that is not UTF-8, as a file's name may be."""
    try:
        text.encode()
    except UnicodeEncodeError:
        raise ValueError(f"{name} is {text!r}, which is not UTF-8") from None
    return text


def texts_of(values: Mapping[str, Any]) -> dict[str, str]:
    """Returns settings as texts, with the folder of the ROMs. Refuses unknown names and impossible values."""
    texts = {name: text_of(name, value) for name, value in values.items() if (name, value) != ("rom_dir", None)}
    _core.check_settings(texts)
    if not texts.get("rom_dir"):
        texts["rom_dir"] = _roms_of_ale_py()
    return texts


def _roms_of_ale_py() -> str:
    """Returns the folder of ale-py's ROMs if it is installed and the user named no other; else nothing."""
    if os.environ.get("ALE_ROMS_DIR"):
        return ""
    ale_py = importlib.util.find_spec("ale_py")
    if ale_py is None or ale_py.origin is None:
        return ""
    roms = Path(ale_py.origin).parent / "roms"
    return require_utf8("rom_dir", str(roms)) if any(roms.glob("*.bin")) else ""


def rom_hint(error: RuntimeError) -> Exception:
    """Returns the error, with one more way out where a ROM is missing."""
    if "the ROM file" in str(error) and " is not in " in str(error):
        return FileNotFoundError(f"{error}; or install ale-py, which brings the ROMs: pip install ale-py")
    return error


def with_settings(apart: Iterable[str]) -> Callable[[_Function], _Function]:
    """Gives a function that takes **settings their names and defaults as its signature, and their sentences as
    the end of its docstring. `apart`: those that are arguments of their own."""

    def give(function: _Function) -> _Function:
        table = [setting for setting in _core.settings() if setting["name"] not in apart]
        signature = inspect.signature(function)
        own = [p for p in signature.parameters.values() if p.kind is not inspect.Parameter.VAR_KEYWORD]
        by_name = [inspect.Parameter(s["name"], inspect.Parameter.KEYWORD_ONLY, default=s["default"]) for s in table]
        # Its type is for type checkers alone; get_type_hints() would look for it.
        function.__annotations__.pop("settings", None)
        function.__signature__ = signature.replace(parameters=own + by_name)  # type: ignore[attr-defined]
        lines = []
        for setting in table:
            kind = setting["type"] + (f", {setting['range']}" if setting["range"] else "")
            default = setting["default"] if setting["default"] != "" else "''"
            lines.append(f"    {setting['name']} = {default}  ({kind})\n        {setting['help']}")
        doc = inspect.cleandoc(function.__doc__ or "")
        function.__doc__ = doc + "\n\nSettings:\n" + "\n".join(lines) + "\n"
        return function

    return give
