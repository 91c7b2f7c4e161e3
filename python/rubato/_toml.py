"""Problem files as text, and the names that they may hold."""

from __future__ import annotations

import functools
import inspect
import json
import math
import numbers

import numpy as np

from . import _core


def value_text(value) -> str:
    """Returns a value as TOML. Numbers keep all their digits."""
    if isinstance(value, (bool, np.bool_)):
        return "true" if value else "false"
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False)
    if isinstance(value, numbers.Integral):
        return str(int(value))
    if isinstance(value, (numbers.Real, np.floating)):
        number = float(value)
        if not math.isfinite(number):
            raise ValueError(f"a problem takes finite numbers, and not {number!r}")
        return repr(number)
    if isinstance(value, dict):
        entries = ", ".join(f"{key_text(key)} = {value_text(item)}" for key, item in value.items())
        return f"{{ {entries} }}" if entries else "{}"
    if isinstance(value, np.ndarray):
        return value_text(value.tolist())
    if isinstance(value, (list, tuple)):
        return f"[{', '.join(value_text(item) for item in value)}]"
    raise TypeError(f"a problem takes numbers, texts, lists and tables, and not {type(value).__name__} ({value!r})")


def key_text(key: str) -> str:
    if not isinstance(key, str):
        raise TypeError(f"a name is a text, and not {key!r}")
    plain = key and all(c.isascii() and (c.isalnum() or c in "_-") for c in key)
    return key if plain else json.dumps(key, ensure_ascii=False)


def text(tables: dict) -> str:
    """Returns tables by their names, in order, as a problem file; those without entries are left out. "" is the top."""
    parts = []
    for name, entries in tables.items():
        lines = [f"{key_text(key)} = {value_text(value)}" for key, value in entries.items()]
        if lines:
            parts.append("\n".join(([f"[{name}]"] if name else []) + lines))
    return "\n\n".join(parts) + "\n"


_keys: dict = {}


def keys(table: str) -> dict:
    """Returns the keys that a table of a problem file may have, with what each means."""
    if not _keys:
        for its_table, name, _type, meaning in _core.problem_keys():
            _keys.setdefault(its_table, {})[name] = meaning
    return _keys.get(table, {})


def suggestion(word: str, known) -> str:
    """Returns "; did you mean ...?" for the nearest of the known words, or nothing."""
    text = _core.did_you_mean(word, [name for name in known if not name.startswith("_")])
    return f"; {text.lstrip('; ')}" if text else ""


def unknown_keyword(function: str, word: str, known) -> TypeError:
    return TypeError(f"{function} takes no keyword {word!r}{suggestion(word, known)}")


def suggesting(function):
    """The function, which answers an unknown keyword with a suggestion."""
    known = [p.name for p in inspect.signature(function).parameters.values() if p.name != "self"]
    name = function.__qualname__.replace(".__init__", "").rpartition(".")[2]

    @functools.wraps(function)
    def call(*arguments, **keywords):
        for word in keywords:
            if word not in known:
                raise unknown_keyword(name, word, known)
        return function(*arguments, **keywords)

    return call
