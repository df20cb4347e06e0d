"""Reports of the Khronos validator on glTF files: a reader of bench/models.py.

usage: validator_reader.py [COMMAND...]

Takes the report FILE.report.json, or NAME.report.json without the file's ending, that lies beside
a file, as in the validator's own tests; else what COMMAND FILE prints (gltf_validator -o). Of
other files, and without either, nothing is reported.
"""

import json
import pathlib
import subprocess
import sys

sys.path.append(str(pathlib.Path(__file__).parents[1]))
import model_facts  # noqa: E402

ERROR = 0


def read(path):
    path = pathlib.Path(path)
    if path.suffix.lower() not in (".gltf", ".glb"):
        return {}
    report = report_of(path)
    if report is None:
        return {}
    codes = sorted({m["code"] for m in report["issues"]["messages"] if m["severity"] == ERROR})
    return {"refusal": " ".join(codes), "codes": codes} if codes else {}


def report_of(path):
    for beside in (path.with_name(f"{path.name}.report.json"), path.with_suffix(".report.json")):
        if beside.exists():
            return json.loads(beside.read_text())
    if len(sys.argv) < 2:
        return None
    done = subprocess.run([*sys.argv[1:], str(path)], capture_output=True, text=True, timeout=60)
    return json.loads(done.stdout)


if __name__ == "__main__":
    model_facts.serve(read)
