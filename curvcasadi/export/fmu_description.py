"""The XML files of a functional mock-up unit."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, field
from xml.etree import ElementTree as Xml

import numpy as np

from curvcasadi.control.model import ControlModel
from curvcasadi.symbolic.expressions import Array
from curvcasadi.symbolic.layout import Layout

_TOOL = "curvcasadi"


@dataclass(frozen=True, kw_only=True)
class Variable:
    """A variable of an FMU."""

    name: str
    reference: int
    attributes: dict[str, str] = field(default_factory=dict)


def model_description(
    model: ControlModel,
    name: str,
    token: str,
    start: Mapping[str, Array],
    *,
    inputs: Collection[str],
    step: float,
) -> bytes:
    """modelDescription.xml of a model whose library is called `name`."""
    root = Xml.Element(
        "fmiModelDescription",
        fmiVersion="3.0",
        modelName=model.name,
        instantiationToken=token,
        generationTool=_TOOL,
        variableNamingConvention="structured",
    )
    Xml.SubElement(
        root,
        "ModelExchange",
        modelIdentifier=name,
        canGetAndSetFMUState="true",
        canSerializeFMUState="true",
    )
    Xml.SubElement(
        root,
        "CoSimulation",
        modelIdentifier=name,
        canHandleVariableCommunicationStepSize="true",
        canGetAndSetFMUState="true",
        canSerializeFMUState="true",
    )
    variables = {key: list(found) for key, found in _variables(model, start, inputs).items()}
    units = {v.attributes.get("unit") for group in variables.values() for v in group} - {None}
    definitions = Xml.SubElement(root, "UnitDefinitions")
    for unit in sorted(str(u) for u in units):
        Xml.SubElement(definitions, "Unit", name=unit)
    if not units:
        root.remove(definitions)
    categories = Xml.SubElement(root, "LogCategories")
    Xml.SubElement(categories, "Category", name="logStatusError")
    Xml.SubElement(root, "DefaultExperiment", startTime="0", stopTime="1", stepSize=repr(step))
    described = Xml.SubElement(root, "ModelVariables")
    clock = {"causality": "independent", "variability": "continuous"}
    Xml.SubElement(described, "Float64", {"name": "time", "valueReference": "0", **clock})
    for group in variables.values():
        for v in group:
            named = {"name": v.name, "valueReference": str(v.reference)}
            Xml.SubElement(described, "Float64", named | v.attributes)
    structure = Xml.SubElement(root, "ModelStructure")
    for kind, key in (
        ("Output", "y"),
        ("ContinuousStateDerivative", "xdot"),
        ("InitialUnknown", "y"),
        ("InitialUnknown", "xdot"),
    ):
        for v in variables[key]:
            Xml.SubElement(structure, kind, valueReference=str(v.reference))
    return _text(root)


def build_description(name: str, sources: Collection[str]) -> bytes:
    """buildDescription.xml: how an importing tool compiles the sources."""
    root = Xml.Element("fmiBuildDescription", fmiVersion="3.0")
    configuration = Xml.SubElement(root, "BuildConfiguration", modelIdentifier=name)
    group = Xml.SubElement(configuration, "SourceFileSet", language="C99")
    for file in sorted(file for file in sources if file.endswith(".c")):
        Xml.SubElement(group, "SourceFile", name=file)
    return _text(root)


def _variables(
    model: ControlModel, start: Mapping[str, Array], inputs: Collection[str]
) -> dict[str, list[Variable]]:
    """Variables by kind, in the order of their value references, which begin with 1."""
    reference = 1
    found: dict[str, list[Variable]] = {}
    for key in ("x", "xdot", "u", "p", "y"):
        layout: Layout = model.x if key == "xdot" else getattr(model, key)
        group = []
        for k, (part, name, unit) in enumerate(_entries(layout)):
            attributes = _attributes(key, part in inputs)
            full = f"{'x' if key == 'xdot' else key}.{name}"
            if key == "xdot":
                full = f"der({full})"
                attributes["derivative"] = str(found["x"][k].reference)
            else:
                attributes["unit"] = unit
            if key in start:
                attributes["start"] = repr(float(start[key][k]))
                attributes |= _bounds(layout, k)
            group.append(Variable(name=full, reference=reference, attributes=attributes))
            reference += 1
        found[key] = group
    return found


def _attributes(key: str, as_input: bool) -> dict[str, str]:
    if key == "u" or as_input:
        return {"causality": "input", "variability": "continuous"}
    if key == "p":
        return {"causality": "parameter", "variability": "tunable", "initial": "exact"}
    causality = "output" if key == "y" else "local"
    initial = "exact" if key == "x" else "calculated"
    return {"causality": causality, "variability": "continuous", "initial": initial}


def _bounds(layout: Layout, k: int) -> dict[str, str]:
    """Finite bounds of an entry."""
    sides = zip(("min", "max"), layout.bounds, strict=True)
    return {name: repr(float(side[k])) for name, side in sides if np.isfinite(side[k])}


def _entries(layout: Layout) -> Iterator[tuple[str, str, str]]:
    """Part, name and unit of every entry; parts of one entry have no index."""
    for part in layout.parts:
        for i in range(part.size):
            name = part.name if part.size == 1 else f"{part.name}[{i}]"
            yield part.name, name, part.unit


def _text(root: Xml.Element) -> bytes:
    Xml.indent(root)
    return bytes(Xml.tostring(root, encoding="UTF-8", xml_declaration=True)) + b"\n"
