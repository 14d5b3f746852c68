"""The scene in the README does what the README says."""

import contextlib
import io
import re
import subprocess
from pathlib import Path

README = (Path(__file__).parents[1] / "README.md").read_text()


def test_the_scene_prints_what_the_text_says():
    scene = re.search(r"```python\n(.*?)```", README, re.DOTALL).group(1)
    said = re.search(r"It prints `(.*?)`", README).group(1)
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed):
        exec(scene, {})
    assert printed.getvalue().strip() == said


def test_the_apt_line_names_what_the_set_up_asks_for():
    script = Path(__file__).parents[1] / "scripts" / "setup.sh"
    asked = subprocess.run(
        ["sh", script, "apt-packages"], capture_output=True, text=True, check=True
    ).stdout.split()
    assert len(asked) > 5
    for package in asked:
        assert package in README, package
