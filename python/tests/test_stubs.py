"""The type stubs and the compiled module agree: names, parameters, defaults, docstrings."""

import ast
import inspect
from pathlib import Path
from typing import Any

import quasirigid as qr
from quasirigid import _quasirigid, errors

STUBS = Path(_quasirigid.__file__).with_name("_quasirigid.pyi")


def stub() -> dict[str, Any]:
    tree = ast.parse(STUBS.read_text())
    names: dict[str, Any] = {}
    for node in tree.body:
        if isinstance(node, ast.ClassDef):
            members = {n.name: n for n in node.body if isinstance(n, ast.FunctionDef)}
            fields = {n.target.id for n in node.body if isinstance(n, ast.AnnAssign) and isinstance(n.target, ast.Name)}
            names[node.name] = (members, fields)
    return names


def test_every_error_is_part_of_the_package() -> None:
    kinds = {
        name for name, thing in vars(errors).items() if isinstance(thing, type) and issubclass(thing, (errors.QuasirigidError, Warning))
    }
    assert kinds == set(errors.__all__)
    assert kinds <= set(qr.__all__)


def test_stubs_name_exactly_what_the_module_has() -> None:
    classes = {name: thing for name, thing in vars(_quasirigid).items() if inspect.isclass(thing)}
    described = stub()
    assert set(classes) == set(described)
    for name, thing in classes.items():
        members, fields = described[name]
        there = {m for m in vars(thing) if not m.startswith("_")}
        assert there == {m for m in members if not m.startswith("_")} | fields, name
        assert ("__len__" in vars(thing)) == ("__len__" in members), name


def test_stubs_have_the_parameters_and_defaults_of_the_module() -> None:
    for name, (members, _) in stub().items():
        for member, node in members.items():
            of_class = getattr(_quasirigid, name)
            if any(isinstance(d, ast.Attribute) or getattr(d, "id", "") == "property" for d in node.decorator_list):
                continue
            if member.startswith("__") and member != "__init__":
                continue
            signature = inspect.signature(of_class if member == "__init__" else getattr(of_class, member))
            there = {p.name: p.default for p in signature.parameters.values() if p.name != "self"}
            places, named = node.args.args, node.args.kwonlyargs
            defaults = [*[None] * (len(places) - len(node.args.defaults)), *node.args.defaults, *node.args.kw_defaults]
            stubbed = {
                a.arg: inspect.Parameter.empty if default is None else ast.literal_eval(default)
                for a, default in zip([*places, *named], defaults, strict=True)
                if a.arg != "self"
            }
            assert there == stubbed, f"{name}.{member}"
            assert {p.name for p in signature.parameters.values() if p.kind is p.KEYWORD_ONLY} == {a.arg for a in named}, f"{name}.{member}"


def test_help_says_what_the_stubs_say() -> None:
    tree = ast.parse(STUBS.read_text())
    for node in (n for n in tree.body if isinstance(n, ast.ClassDef)):
        of_class = getattr(_quasirigid, node.name)
        parts = [ast.get_docstring(node)]
        for member in node.body:
            if isinstance(member, ast.FunctionDef):
                text = ast.get_docstring(member)
                if member.name == "__init__":
                    parts.append(text)
                elif text is not None and not member.name.startswith("__"):
                    assert inspect.getdoc(getattr(of_class, member.name)) == text, f"{node.name}.{member.name}"
            elif isinstance(member, ast.Expr) and member is not node.body[0]:
                parts.append(ast.literal_eval(member.value))
        assert inspect.getdoc(of_class) == "\n\n".join(part for part in parts if part), node.name
