"""The Python of the README runs, and says what a reader is to see."""

import re
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]


def test_the_python_of_the_readme_runs() -> None:
    blocks = re.findall(r"^```python\n(.*?)^```$", (ROOT / "README.md").read_text(), flags=re.MULTILINE | re.DOTALL)
    assert blocks, "the README has no Python"
    for block in blocks:
        done = subprocess.run([sys.executable, "-W", "error", "-c", block], capture_output=True, text=True, timeout=120, check=False)
        assert done.returncode == 0, done.stderr
        print(done.stdout)
        if "box moves at" in block:
            figures = re.search(
                r"(\d+) contacts, residual (\S+), box moves at (\S+) m/s\npeak pressure (\d+) kPa, (\d+) contacts stick", done.stdout
            )
            assert figures is not None, done.stdout
            assert float(figures[3]) < 1e-9, f"the box creeps at {figures[3]} m/s"
            assert int(figures[5]) > 0
