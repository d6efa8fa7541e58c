"""What the program says is for somebody who has installed the package, and nothing else: no message names a file of the repository."""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

REPOSITORY = Path(__file__).resolve().parents[2]
NAMED = re.compile(
    r"\b(docs|benchmarks|crates|tools|tests|python)/|\b(CONTRIBUTING|README|NOTICE|CHANGELOG|Makefile|requirements)\b|"
    r"\bmake (setup|test|view|fuzz|bench|audit)\b"
)


def of_python(path: Path) -> Iterator[tuple[int, str]]:
    """Texts of a module but for docstrings and other texts that stand by themselves."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    alone = {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Expr)}
    for node in ast.walk(tree):
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in alone:
            yield node.lineno, node.value


def of_others(path: Path) -> Iterator[tuple[int, str]]:
    """Lines of Rust, JavaScript and HTML but for comments, and for unit tests at the foot of the file."""
    text = path.read_text(encoding="utf-8").partition("#[cfg(test)]")[0]
    for number, line in enumerate(text.splitlines(), 1):
        yield number, re.sub(r"(^|\s)//.*", "", line)


def test_messages_name_no_file_that_somebody_with_the_package_alone_lacks() -> None:
    python = sorted((REPOSITORY / "python" / "quasirigid").rglob("*.py"))
    others = [path for folder in sorted((REPOSITORY / "crates").glob("*/src")) for path in sorted(folder.rglob("*.rs"))]
    page = REPOSITORY / "python" / "quasirigid" / "mocap" / "webxr" / "static"
    others += [page / "index.html", *(path for path in sorted(page.glob("*.js")) if path.name != "three.js")]
    assert len(python) > 50
    assert len(others) > 50
    found = [
        f"{path.relative_to(REPOSITORY)}:{number}: {text.strip()[:120]}"
        for path in (*python, *others)
        for number, text in (of_python(path) if path.suffix == ".py" else of_others(path))
        if NAMED.search(text)
    ]
    assert not found, "\n".join(found)
