"""Everything that needs a GPU, from an unpacked bundle: the tests of the CPU backend against a
daemon with `--backend cuda`, what tests/gpu checks, and the bench. Prints a line for each part and
writes them as a table.

usage: suite.py BUNDLE [FOLDER [PART...]]
BUNDLE is where scripts/bundle's archive was unpacked; FOLDER gets table.md and each part's output.
Needs Python 3.12 with pytest, Pillow, OpenEXR and tqdm, and a checkout of the same commit around
this file; `lost` also heliographd-faulty of the build tree in BUNDLE/bin.
Ends with 1 if a part fails.
"""

import ast
import importlib.util
import os
import pathlib
import stat
import subprocess
import sys
import tempfile
import time

ROOT = pathlib.Path(__file__).resolve().parents[2]
FILES_OF_EXR = (  # the client reads and writes them by the package OpenEXR
    "test_dataset_faults.py::test_a_disk_that_is_full_is_told[Exr]",
    "test_elsewhere.py",
    "test_half.py::test_half_frames_are_shown_and_kept_as_others_are",
    "test_nvisii_examples.py::test_materials",
    "test_paper_scenes.py::test_all_labels_and_labels_alone",
    "test_validate_writers.py::test_exr",
)
HAS_EXR = importlib.util.find_spec("OpenEXR") is not None
LEFT_OUT = {
    "test_cpp_client.py": "programs of the build tree",
    "test_client_programs.py": "programs of the build tree",
    "test_protocol_example.py": "protoc",
    "test_newer_daemon.py": "programs of the build tree",
    "test_device_frames.py": "programs of the build tree",
    "test_tls.py::test_the_cpp_client_speaks_tls": "programs of the build tree",
    "test_denoise.py": "a bundle made with --denoiser",
    "test_queries.py::test_a_pick_agrees_with_the_planes": "edges where rays of host and GPU part",
    "test_replay_questions.py::test_a_question_is_played_before_the_next_edit": "slow edits",
    "test_batch.py::test_items_come_back_as_they_are_done": "a job that is long on a GPU",
    "test_batch.py::test_what_is_not_for_a_batch_is_refused": "the same",
    "test_device_edits.py": "heliographd-faulty beside the test's daemon",
    "test_worlds.py::test_progress_counts_all_pictures": "the same",
    "test_cluster.py": "Ray",
    "test_docs.py::test_the_site_builds_without_a_warning": "Sphinx",
    "test_randomizers.py::test_things_fall_and_rest_on_the_floor_without_meeting": "PyBullet",
    "test_randomizers.py::test_things_fall_as_fast_as_gravity_has_it": "PyBullet",
    "test_randomizers.py::test_contacts_have_the_friction_and_the_restitution_that_are_asked_for": (
        "PyBullet"
    ),
    "test_randomizers.py::test_a_draw_is_pure_in_its_seed_and_index[<lambda>6]": "PyBullet",
    **dict.fromkeys(() if HAS_EXR else FILES_OF_EXR, "the package OpenEXR"),
}
PARTS = {  # in this order, or in that of the command line
    "pictures": ["-m", "pytest", "-q", "tests/image"],
    "integration": ["-m", "pytest", "-q", "tests/integration"]
    + [f"--deselect=tests/integration/{name}" for name in LEFT_OUT],
    "parity": ["tests/gpu/parity.py"],
    "builders": ["tests/gpu/builders.py"],
    "cycles": ["tests/gpu/cycles.py"],
    "frames": ["tests/gpu/frames.py"],
    "memory": ["tests/gpu/memory.py"],
    "lost": ["tests/gpu/lost.py"],
    "denoise": ["tests/gpu/denoise.py"],
    "stream": ["tests/gpu/stream.py"],
    "training": ["examples/train_on_gpu.py"],
    "sanitized": ["tests/gpu/sanitized.py"],
    "speed": ["bench/gpu.py"],
    "worlds": ["bench/gpu_worlds.py"],
    "overlay": ["bench/gpu_overlay.py"],
    "devices": ["bench/devices.py"],
}


def gpus():
    return len(subprocess.check_output(["nvidia-smi", "-L"], text=True).splitlines())


def has_denoiser(bundle):
    """As a part of the bundle, or from the package that the client finds."""
    beside = pathlib.Path(bundle, "lib/libOpenImageDenoise.so.2")
    return beside.exists() or importlib.util.find_spec("pyoidn") is not None


def environment(bundle, folder):
    """Where clients find the bundle's daemon, and one of its own that has the GPU."""
    wrapper = folder / "heliographd"
    wrapper.write_text(f'#!/bin/sh\nexec {bundle}/bin/heliographd --backend cuda "$@"\n')
    wrapper.chmod(wrapper.stat().st_mode | stat.S_IXUSR)
    own = {"HELIOGRAPHD": f"{bundle}/bin/heliographd"}
    own["HELIOGRAPH_DECODE"] = f"{bundle}/bin/heliograph-decode"
    paths = [f"{bundle}/python", f"{ROOT}/clients/nvisii", os.environ.get("PYTHONPATH", "")]
    own["PYTHONPATH"] = os.pathsep.join(paths)
    return {**os.environ, **own}, {**os.environ, **own, "HELIOGRAPHD": str(wrapper)}


def imports(file):
    """Names of the modules that a test imports, its neighbours' included."""
    names = {
        name.split(".")[0]
        for node in ast.walk(ast.parse(file.read_text()))
        for name in (
            [alias.name for alias in node.names]
            if isinstance(node, ast.Import)
            else [node.module or ""]
            if isinstance(node, ast.ImportFrom)
            else []
        )
    }
    near = [file.with_name(f"{name}.py") for name in names]
    return names.union(*(imports(other) for other in near if other.exists() and other != file))


def lacking(bundle):
    """Integration tests that need packages which are not here, and the first of those."""
    own = [*pathlib.Path(bundle, "python").iterdir(), *(ROOT / "scripts").iterdir()]
    own += (ROOT / "tests").rglob("*.py")
    there = {path.stem for path in own}
    out = {}
    for file in sorted((ROOT / "tests/integration").glob("test_*.py")):
        needed = sorted(imports(file) - there - {""})
        missing = [name for name in needed if importlib.util.find_spec(name) is None]
        if missing:
            out[file.name] = f"the package {missing[0]}"
    return out


def main(bundle, folder=None, *parts):
    rows = []
    left_out = LEFT_OUT | lacking(bundle)
    if folder:
        pathlib.Path(folder).mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as made:
        plain, on_gpu = environment(pathlib.Path(bundle).resolve(), pathlib.Path(made))
        for name in parts or PARTS:
            arguments = list(PARTS[name])
            if name == "integration":
                arguments += [f"--ignore=tests/integration/{file}" for file in lacking(bundle)]
            if name == "devices" and gpus() < 2:
                print("== devices: left out, as there is one GPU")
                continue
            if name == "denoise" and not has_denoiser(bundle):
                print("== denoise: left out, as the bundle has no Open Image Denoise")
                continue
            begin = time.monotonic()
            env = on_gpu if "pytest" in arguments else plain
            done = subprocess.run(
                [sys.executable, *arguments],
                cwd=ROOT,
                env=env,
                text=True,
                stdout=subprocess.PIPE,
                stderr=subprocess.STDOUT,
                check=False,
            )
            output = [line for line in done.stdout.splitlines() if line.strip()] or [""]
            rows.append((name, done.returncode, time.monotonic() - begin, output))
            print(f"== {name}: {'ok' if done.returncode == 0 else 'FAILED'}, {rows[-1][2]:.0f} s")
            print("\n".join(output[-40:]), flush=True)
            if folder:
                pathlib.Path(folder, f"{name}.log").write_text(done.stdout)
    lines = ["| part | | seconds | |", "|---|---|---|---|"]
    for name, code, took, output in rows:
        lines.append(f"| {name} | {'FAILED' if code else 'ok'} | {took:.0f} | {output[-1]} |")
    print("\n".join(lines))
    lines += [f"\nLeft out, as they need {why}: {name}" for name, why in left_out.items()]
    if folder:
        pathlib.Path(folder, "table.md").write_text("\n".join(lines) + "\n")
    sys.exit(any(code for _, code, _, _ in rows))


if __name__ == "__main__":
    main(*sys.argv[1:])
