"""The JSON Schema of a case file, for editors that complete and check while one types. Knows keys, reads nothing.

Put ``#:schema case.schema.json`` in the first line of a case file, or tell the editor (Taplo, Even Better TOML) that it
holds for ``*.case.toml``. The reader (case.py) stays the judge: it also checks files and what keys say of each other.
"""

from __future__ import annotations

import copy
from typing import Any

from estimator.cases.case import FILE
from estimator.method_names import added


def schema() -> dict[str, Any]:
    """Return the schema (JSON Schema 2020-12) as plain data, with the methods that installed packages add."""
    properties = copy.deepcopy(FILE)
    properties["search"]["properties"]["method"]["enum"] += added()
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "Case file of fmu-estimator",
        "type": "object",
        "properties": properties,
        "additionalProperties": False,
        "required": ["recording"],
    }
