"""Files of deploy/ mean what they should: settings that the daemon takes, images and pods that are
locked in, package lists that are those of scripts/setup. deploy/build_image runs the images."""

import configparser
import json
import os
import pathlib
import re
import shutil
import subprocess
import sys
import tomllib
import urllib.request

import heliograph as hg
import pytest
import yaml

ROOT = pathlib.Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "tests/fault"))
from served import served  # noqa: E402

DEPLOY = ROOT / "deploy"
DAEMON = pathlib.Path(os.environ.get("HELIOGRAPHD", ROOT / "build/cpu/bin/heliographd"))
VENV = ROOT / ".venv/bin"
DOCKERFILES = sorted(DEPLOY.glob("Dockerfile.*"))
NOT_IN_AN_IMAGE = {
    "catch2",
    "ccache",
    "git",
    "python3",
    "clang-format-19",
    "xz-utils",
}


@pytest.mark.parametrize("path", sorted(DEPLOY.rglob("*.toml")), ids=lambda p: str(p.parent.name))
def test_the_daemon_takes_the_settings(path):
    settings = tomllib.loads(path.read_text())  # stricter than the daemon about what is TOML
    assert settings["drain"] == 20
    result = subprocess.run(
        [DAEMON, "--config", path, "--socket-group", "0", "--probe", "live"],
        capture_output=True,
        text=True,
        timeout=20,
    )
    assert result.returncode == 1, result.stderr  # it read them, and nobody answers there


# ---------------------------------------------------------------- systemd


def unit() -> configparser.ConfigParser:
    parser = configparser.ConfigParser(strict=True, interpolation=None)
    parser.optionxform = str
    parser.read_string((DEPLOY / "heliographd.service").read_text())
    return parser


def test_the_unit_stops_after_the_drain():
    service = unit()["Service"]
    assert int(service["TimeoutStopSec"]) >= 20 + 10
    assert service["RestartPreventExitStatus"] == "64 65"
    assert "/etc/heliograph/heliographd.toml" in service["ExecStart"]


@pytest.mark.skipif(shutil.which("systemd-analyze") is None, reason="no systemd here")
def test_systemd_finds_the_unit_good_and_safe(tmp_path):
    path = tmp_path / "heliographd.service"
    text = (DEPLOY / "heliographd.service").read_text()
    path.write_text(text.replace("/usr/bin/heliographd", str(DAEMON)))
    verified = subprocess.run(
        ["systemd-analyze", "verify", "--man=no", path], capture_output=True, text=True, timeout=60
    )
    complaints = [line for line in verified.stderr.splitlines() if "heliographd.service" in line]
    assert not complaints
    secure = subprocess.run(
        ["systemd-analyze", "security", "--offline=true", "--threshold=25", path],
        capture_output=True,
        text=True,
        timeout=60,
    )
    assert secure.returncode == 0, secure.stdout[-300:]  # exposure at most 2.5 of 10


# ---------------------------------------------------------------- images


def instructions(path: pathlib.Path) -> list[tuple[str, str]]:
    """(instruction, rest), with continued lines joined."""
    text = re.sub(r"\\\n", " ", path.read_text())
    lines = [line for line in text.splitlines() if line and not line.startswith("#")]
    return [tuple(line.split(None, 1)) for line in lines]


def packages(rest: str) -> set[str]:
    found = re.search(r"--no-install-recommends (.*?)&&", rest)
    return set(found[1].split()) if found else set()


@pytest.mark.parametrize("path", DOCKERFILES, ids=lambda p: p.name)
def test_images_are_locked_in(path):
    stages, stage = {}, ""
    for name, rest in instructions(path):
        assert name in (
            "FROM",
            "RUN",
            "WORKDIR",
            "COPY",
            "USER",
            "STOPSIGNAL",
            "HEALTHCHECK",
            "CMD",
            "ENTRYPOINT",
            "ENV",
        ), name
        if name == "FROM":
            stage = rest.split(" AS ")[1]
            assert ":latest" not in rest and ":" in rest
        if name == "RUN" and "apt-get install" in rest:
            assert "rm -rf /var/lib/apt/lists/*" in rest and packages(rest)
        if name == "COPY" and not rest.startswith("--from"):
            for source in rest.split()[:-1]:
                assert (ROOT / source).exists(), source
        stages.setdefault(stage, {})[name] = rest
    for name in set(stages) - {"built", "wheels"}:
        user, group = stages[name]["USER"].split(":")
        assert int(user) > 10000 and int(group) > 10000
    assert "--probe" in stages["daemon"]["HEALTHCHECK"]
    assert stages["daemon"]["STOPSIGNAL"] == "SIGTERM"


@pytest.mark.parametrize("path", DOCKERFILES, ids=lambda p: p.name)
def test_hadolint_finds_images_good(path):
    found = subprocess.run([VENV / "hadolint", path], capture_output=True, text=True, timeout=60)
    assert found.returncode == 0, found.stdout


def test_what_images_copy_is_in_their_context():
    lines = (ROOT / ".dockerignore").read_text().splitlines()
    assert "*" in lines
    allowed = {line[1:] for line in lines if line.startswith("!")}
    for path in DOCKERFILES:
        for name, rest in instructions(path):
            if name == "COPY" and not rest.startswith("--from"):
                for source in rest.split()[:-1]:
                    parents = {str(each) for each in pathlib.PurePath(source).parents}
                    assert allowed & {source, *parents}, source


@pytest.mark.parametrize("path", DOCKERFILES, ids=lambda p: p.name)
def test_images_are_built_with_what_setup_installs(path):
    listed = re.search(r"packages=\((.*?)\n\)", (ROOT / "scripts/setup").read_text(), re.S)
    first = next(rest for name, rest in instructions(path) if name == "RUN")
    assert packages(first) == set(listed[1].split()) - NOT_IN_AN_IMAGE


# ---------------------------------------------------------------- memory


def bytes_of(text: str) -> int:
    found = re.fullmatch(r"(\d+)(Gi|G|g)", text)
    return int(found[1]) << 30


def memory_of_unit() -> int:
    return bytes_of(unit()["Service"]["MemoryMax"])


def memory_of_compose() -> int:
    services = yaml.safe_load((DEPLOY / "compose.yaml").read_text())["services"]
    return bytes_of(services["heliographd"]["mem_limit"])


def memory_of_pod() -> int:
    deployment = yaml.safe_load((DEPLOY / "kubernetes/base/worker.yaml").read_text())
    daemon = deployment["spec"]["template"]["spec"]["initContainers"][0]
    return bytes_of(daemon["resources"]["limits"]["memory"])


@pytest.mark.parametrize(
    ("settings", "memory"),
    [
        ("heliographd.toml", memory_of_unit),
        ("heliographd.toml", memory_of_compose),
        ("kubernetes/base/heliographd.toml", memory_of_pod),
    ],
)
def test_the_limits_add_up_to_the_memory_there_is(settings, memory):
    """With an eighth for the daemon itself. What is of one request or one process is there once for
    each that the totals do not hold."""
    limits = tomllib.loads((DEPLOY / settings).read_text())["limits"]
    total = (
        limits["blob_store_bytes"]
        + limits["derived_bytes"]
        + limits["quota_bytes"]
        + limits["frame_bytes"]
        + limits["shared_bytes"]
        + limits["decodes"] * limits["decode_bytes"]
    )
    assert total <= memory() * 7 // 8
    assert limits["tenant_bytes"] <= limits["blob_store_bytes"]
    assert limits["blob_bytes"] < limits["tenant_bytes"]
    assert limits["array_bytes"] < limits["tenant_bytes"]
    assert limits["decode_result_bytes"] < limits["decode_bytes"]


# ---------------------------------------------------------------- compose and Kubernetes


def test_composed_services_share_a_socket_and_nothing_else():
    services = yaml.safe_load((DEPLOY / "compose.yaml").read_text())["services"]
    assert set(services) == {"heliographd", "trainer"}
    groups = set()
    for service in services.values():
        assert service["read_only"] and service["network_mode"] == "none"
        assert service["cap_drop"] == ["ALL"] and "ports" not in service
        assert service["security_opt"] == ["no-new-privileges:true"]
        assert "sockets:/run/heliograph" in service["volumes"]
        user, group = service["user"].split(":")
        assert int(user) > 10000
        groups.add(group)
        dockerfile = (DEPLOY / "compose.yaml").parent / service["build"]["context"]
        target = f" AS {service['build']['target']}\n"
        assert target in (dockerfile / service["build"]["dockerfile"]).read_text()
    assert len(groups) == 1
    assert services["heliographd"]["stop_grace_period"] == "35s"


def check_pod(spec: dict, claims: set[str] = frozenset()) -> None:
    assert spec["automountServiceAccountToken"] is False
    assert spec["securityContext"]["runAsNonRoot"] is True
    assert spec["securityContext"]["seccompProfile"] == {"type": "RuntimeDefault"}
    assert spec["terminationGracePeriodSeconds"] >= 30
    volumes = {volume["name"] for volume in spec["volumes"]} | claims
    for container in spec.get("initContainers", []) + spec["containers"]:
        context = container["securityContext"]
        assert context["runAsUser"] > 10000
        assert context["allowPrivilegeEscalation"] is False
        assert context["readOnlyRootFilesystem"] is True
        assert context["capabilities"] == {"drop": ["ALL"]}
        assert "memory" in container["resources"]["limits"]
        assert {mount["name"] for mount in container["volumeMounts"]} <= volumes


def test_the_pod_is_locked_in():
    base = DEPLOY / "kubernetes/base"
    listed = yaml.safe_load((base / "kustomization.yaml").read_text())["resources"]
    own = {name for name in listed if not name.startswith("../")}
    assert {path.name for path in base.glob("*.yaml")} == {*own, "kustomization.yaml"}
    deployment = yaml.safe_load((base / "worker.yaml").read_text())
    check_pod(deployment["spec"]["template"]["spec"])
    daemon = deployment["spec"]["template"]["spec"]["initContainers"][0]
    assert daemon["readinessProbe"]["exec"]["command"][-1] == "ready"
    assert daemon["livenessProbe"]["exec"]["command"][-1] == "live"


OVERLAYS = {
    "base": {"Deployment", "PodDisruptionBudget"},
    "gpu": {"Deployment", "PodDisruptionBudget"},
    "shared": {"StatefulSet", "PodDisruptionBudget", "Service"},
    "dataset": {"Job"},
}


def build(folder: pathlib.Path) -> list[dict]:
    built = subprocess.run(
        ["kubectl", "kustomize", folder], capture_output=True, text=True, timeout=60, check=True
    )
    return list(yaml.safe_load_all(built.stdout))


@pytest.mark.skipif(shutil.which("kubectl") is None, reason="no kubectl here")
@pytest.mark.parametrize("overlay", OVERLAYS)
def test_overlays_build(overlay, tmp_path):
    built = build(DEPLOY / "kubernetes" / overlay)
    path = tmp_path / "objects.yaml"
    path.write_text(yaml.safe_dump_all(built))
    valid = subprocess.run(
        [VENV / "kubernetes-validate", "--strict", path], capture_output=True, text=True, timeout=60
    )
    assert valid.returncode == 0, valid.stdout + valid.stderr
    objects = {each["kind"]: each for each in built}
    assert set(objects) == {"Namespace", "ConfigMap", "NetworkPolicy", *OVERLAYS[overlay]}
    (workload,) = (
        objects[kind] for kind in ("Deployment", "StatefulSet", "Job") if kind in objects
    )
    pod = workload["spec"]["template"]
    for kind in {"NetworkPolicy", "PodDisruptionBudget", "Service"} & set(objects):
        spec = objects[kind]["spec"]
        labels = spec.get("podSelector", spec["selector"] if "selector" in spec else None)
        assert labels.get("matchLabels", labels).items() <= pod["metadata"]["labels"].items()
    claims = workload["spec"].get("volumeClaimTemplates", [])
    check_pod(pod["spec"], {claim["metadata"]["name"] for claim in claims})
    daemon = (pod["spec"].get("initContainers", []) + pod["spec"]["containers"])[0]
    assert daemon["image"] == ("heliograph:cuda" if overlay == "gpu" else "heliograph:cpu")
    assert ("nvidia.com/gpu" in daemon["resources"]["limits"]) == (overlay == "gpu")
    settings = next(v for v in pod["spec"]["volumes"] if v["name"] == "settings")
    assert settings["configMap"]["name"] == objects["ConfigMap"]["metadata"]["name"]


def test_the_job_makes_every_share_once():
    job = yaml.safe_load((DEPLOY / "kubernetes/dataset/job.yaml").read_text())["spec"]
    arguments = job["template"]["spec"]["containers"][0]["args"]
    assert job["completionMode"] == "Indexed" and "--task=$(JOB_COMPLETION_INDEX)" in arguments
    assert f"--tasks={job['completions']}" in arguments
    script = (ROOT / "examples/slurm/make.py").read_text()
    flags = {argument.partition("=")[0] for argument in arguments if argument.startswith("--")}
    assert all(f'"{flag}"' in script for flag in flags)


@pytest.mark.skipif(shutil.which("kubectl") is None, reason="no kubectl here")
def test_monitoring_looks_at_pods_that_are_there(tmp_path):
    """As a component of each overlay: the monitor finds a port that pods have."""
    shutil.copytree(DEPLOY / "kubernetes", tmp_path / "kubernetes")
    for overlay in ("base", "shared"):
        path = tmp_path / "kubernetes" / overlay / "kustomization.yaml"
        path.write_text(path.read_text() + "components: [../monitoring]\n")
        objects = {each["kind"]: each for each in build(path.parent)}
        (port,) = (each["port"] for each in objects["PodMonitor"]["spec"]["podMetricsEndpoints"])
        workload = objects["StatefulSet" if overlay == "shared" else "Deployment"]["spec"]
        pod = workload["template"]
        containers = pod["spec"].get("initContainers", []) + pod["spec"]["containers"]
        assert port in {each["name"] for c in containers for each in c.get("ports", [])}
        wanted = objects["PodMonitor"]["spec"]["selector"]["matchLabels"]
        assert wanted.items() <= pod["metadata"]["labels"].items()


def expressions() -> list[str]:
    """All that alerts and panels ask Prometheus."""
    monitoring = DEPLOY / "kubernetes/monitoring"
    (group,) = yaml.safe_load((monitoring / "alerts.yaml").read_text())["spec"]["groups"]
    panels = json.loads((monitoring / "dashboard.json").read_text())["panels"]
    rules = [rule["expr"] for rule in group["rules"]]
    return rules + [target["expr"] for panel in panels for target in panel["targets"]]


def test_alerts_and_panels_ask_for_metrics_that_are_there(tmp_path):
    """Their names are those of a daemon that has rendered and decoded."""
    with (
        served("--metrics", "127.0.0.1:0", "--state-dir", str(tmp_path / "state")) as daemon,
        hg.connect(daemon.socket) as client,
        client.create_scene() as scene,
    ):
        with scene.edit() as edit:
            lens = hg.Camera.from_fov(50, 8, 8, degrees=True)
            edit.entity("cam", camera=lens, transform=hg.Pose((0, 0, 1)))
        scene.render("cam", planes=["depth"])
        with urllib.request.urlopen(f"http://{daemon.metrics}/metrics", timeout=5) as reply:
            served_names = set(re.findall(r"^(\w+)[ {]", reply.read().decode(), re.M))
    asked = set(re.findall(r"\b(?:heliograph|process)_\w+", " ".join(expressions())))
    gpu_only = {name for name in asked if name.startswith("heliograph_device_memory")}
    assert len(asked) > 15 and asked - gpu_only <= served_names, asked - served_names
