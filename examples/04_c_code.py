"""Take the forces of a scene and their derivatives into your own C program."""

import subprocess
import tempfile
from pathlib import Path

import numpy as np

from casashell import codegen
from casashell.app.builtin import skirt
from casashell.engine.assembly import Assembly

problem = skirt(8, 26).problem
folder = Path(tempfile.mkdtemp()) / "skirt"
files = codegen(problem, folder)
print(f"{len(files)} files in {folder}: {', '.join(sorted(f.name for f in files)[:4])}, ...")

subprocess.run(["make", "-s", "-C", str(folder), "example"], check=True)
printed = subprocess.run([str(folder / "example")], capture_output=True, text=True, check=True)
in_c = np.array(
    [float(line.split()[1]) for line in printed.stdout.splitlines() if line[:2] == "F "]
)

target = problem.target.vertices
in_python = -Assembly(problem.energies, len(target)).gradient(target, 1.01 * target).ravel()
difference = np.abs(in_c - in_python).max() / np.abs(in_python).max()
print(f"F from C and from Python differ by {difference:.0e}, relative")

if difference > 1e-12:
    raise SystemExit("C and Python disagree")
