"""Every public name says what it takes and gives: numpydoc's validation of all docstrings.

Left out of its checks on purpose: GL01, GL02 (a summary begins on the line of the quotes), SS02 and
SS05 (a summary may be a noun phrase, and begin with a symbol of the equations), PR05 (str is
called str), PR08 and RT04 (a description may begin with a unit or a symbol), YD01, ES01, SA01 and
EX01 (not every name needs a long summary, cross references or an example: the pages of the
documentation have these). PR04, the type of a parameter, is not asked of those that are "As of"
another function. Fields of dataclasses stand under Attributes instead of Parameters, so that PR01
and PR02 are not asked of these.
"""

import dataclasses
import inspect

import pytest
from numpydoc.docscrape import NumpyDocString
from numpydoc.validate import validate

import curvcasadi

CHECKS = {
    *("GL03", "GL05", "GL06", "GL07", "GL08", "GL09", "GL10"),  # sections: known, in order
    *("SS01", "SS03", "SS04", "SS06"),  # a summary of one line that ends with a period
    *("PR01", "PR02", "PR03", "PR04", "PR06", "PR07", "PR09", "PR10"),  # parameters
    *("RT01", "RT03", "RT05"),  # what is returned
}
#: Not of classes whose fields stand under Attributes.
OF_PARAMETERS = {"PR01", "PR02"}


def fields_of(entry):
    """Names of the fields of a dataclass or named tuple; None of what is neither."""
    if dataclasses.is_dataclass(entry):
        return [f.name for f in dataclasses.fields(entry) if f.init and not f.name.startswith("_")]
    return list(getattr(entry, "_fields", ())) or None


def members_of(cls):
    """Public methods and properties of a class that it has not inherited the description of."""
    for name, member in vars(cls).items():
        method = inspect.isfunction(member) or isinstance(
            member, (classmethod, staticmethod, property)
        )
        if method and not name.startswith("_"):
            above = [getattr(parent, name, None) for parent in cls.__mro__[1:]]
            if not any(inspect.getdoc(other) for other in above if other):
                yield name


def faults(path, entry):
    """What numpydoc finds, and fields that stand nowhere."""
    fields = fields_of(entry) if inspect.isclass(entry) else None
    left_out = OF_PARAMETERS if fields else set()
    sections = NumpyDocString(inspect.getdoc(entry) or "")
    elsewhere = {p.name for p in sections["Parameters"] if " ".join(p.desc).startswith("As ")}
    untyped = {
        f'Parameter "{name.strip()}" has no type' for p in elsewhere for name in p.split(",")
    }
    found = [
        f"{path}: {code} {text}"
        for code, text in validate(path)["errors"]
        if code in CHECKS - left_out and not (code == "PR04" and text in untyped)
    ]
    if fields:
        entries = [*sections["Attributes"], *sections["Parameters"]]
        described = {n.strip(): e for e in entries for n in e.name.split(",")}
        for name in fields:
            if name not in described:
                found.append(f"{path}: the field {name} is not described")
            elif not (described[name].type and described[name].desc):
                found.append(f"{path}: the field {name} has no type or no description")
    return found


@pytest.mark.parametrize("name", curvcasadi.__all__)
def test_docstring_is_complete(name):
    entry = getattr(curvcasadi, name)
    found = faults(f"curvcasadi.{name}", entry)
    if inspect.isclass(entry) and not issubclass(entry, Exception):
        for member in members_of(entry):
            found += faults(f"curvcasadi.{name}.{member}", inspect.getattr_static(entry, member))
    assert not found, "\n".join(found)


def test_help_shows_units_and_shapes():
    text = inspect.getdoc(curvcasadi.Beam)
    for words in ("length : ", "m.", "rad/m", "shape (3,)", "parent axes"):
        assert words in text


def test_faults_are_found():
    def undocumented(q):
        """Summary"""

    curvcasadi.undocumented = undocumented
    try:
        codes = {fault.split()[1] for fault in faults("curvcasadi.undocumented", undocumented)}
    finally:
        del curvcasadi.undocumented
    assert {"PR01", "SS03"} <= codes
