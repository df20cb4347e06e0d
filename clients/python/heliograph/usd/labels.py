"""Semantic labels to categories. Needs pxr."""

from __future__ import annotations

from typing import Any


def of(prim: Any, wanted: str | None) -> dict[str, Any]:
    """category and label of a prim with semantics:labels:<wanted> (UsdSemantics), or with
    semantic:<name>:params of the type `wanted` (SemanticsAPI)."""
    if wanted is None:
        return {}
    found = prim.GetAttribute(f"semantics:labels:{wanted}")
    names = list(found.Get() or ()) if found else _older(prim, wanted)
    return {"category": str(names[0]), "label": "auto"} if names else {}


def _older(prim: Any, wanted: str) -> list[str]:
    names = []
    for attribute in prim.GetPropertiesInNamespace("semantic"):
        instance, _, field = attribute.GetName().rpartition(":params:")
        if field == "semanticType" and str(attribute.Get()).lower() == wanted:
            data = prim.GetAttribute(f"{instance}:params:semanticData").Get()
            names += [str(data)] if data else []
    return names
