"""The Prometheus sink, scraped over HTTP."""

from __future__ import annotations

import http.client
import re
import shutil
import socket
import subprocess
import threading
import time
import urllib.error
import urllib.request
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import pytest
import yaml
from prometheus_client.parser import text_string_to_metric_families
from pydantic import ValidationError

from pipeline.errors import InputError
from pipeline.verdict import (
    Basis,
    CameraStatus,
    Cause,
    Event,
    Level,
    Pace,
    PairStatus,
    SinkStatus,
    State,
    Status,
    Verdict,
)
from sinks.prometheus import PrometheusSettings, PrometheusSink
from tests.monitor import Monitor, stereo
from tests.programs import ROOT, inside

ALERTS = ROOT / "examples" / "prometheus" / "alerts.yaml"
PROMTOOL = shutil.which("promtool")

PAIR = PairStatus(
    state=State.ASYNC,
    cause=Cause.SLIP,
    since_ns=5_000_000_000,
    offset_ns=33_300_000,
    sigma_ns=600_000,
    coverage=0.98,
    drift=Pace(stamps_ppm=50.0, stamps_sigma_ppm=2.0, pictures_ppm=51.0, pictures_sigma_ppm=3.0),
    skew_p50_ns=1_000_000,
    skew_p99_ns=33_000_000,
)
CAMERA = CameraStatus(
    fps=29.9, expected_fps=30, frames=900, drops=3, overwritten=8, unpaired=4, duplicates=5, restarts=1, stalls=2,
    jitter_p50_ns=10_000, jitter_p99_ns=200_000, conditions=("dark",), clock="rig", epoch=1,
)  # fmt: skip
STATUS = Status(
    rig="bench", at_ns=7_000_000_000, level=Level.ERROR, reasons=("late",), pairs={"left-right": PAIR},
    cameras={"left": CAMERA, "right": replace(CAMERA, conditions=("frozen", "missing"))}, version="1.2",
    uptime_s=9.5, dropped_windows=6, latency_p99_ns=40_000_000, memory_bytes=123_000_000,
    sinks={"zenoh": SinkStatus(7, 8)},
)  # fmt: skip
EVENT = Event("bench", "a-1", "async", "onset", "left-right", "right", Cause.SLIP, 1, None, {}, "late")
VERDICT = Verdict("bench", "left-right", 0, State.ASYNC, Basis.CONTENT)


def made(**settings: Any) -> PrometheusSink:
    return PrometheusSink(PrometheusSettings(**{"listen": "127.0.0.1:0", **settings}), rig="bench", version="1.2")


@pytest.fixture
def sink() -> Iterator[PrometheusSink]:
    started = made()
    started.start()
    yield started
    started.stop()


def fetched(url: str, accept: str = "text/plain") -> tuple[str, str]:
    request = urllib.request.Request(url, headers={"Accept": accept})  # noqa: S310
    with urllib.request.urlopen(request, timeout=5) as answer:  # noqa: S310
        return answer.headers["Content-Type"], answer.read().decode()


def scraped(sink: PrometheusSink) -> dict[tuple[str, ...], float]:
    """Values by name and the values of the labels but `rig`, in the order of the labels' names."""
    found = {}
    for family in text_string_to_metric_families(fetched(sink.url)[1]):
        for sample in family.samples:
            assert sample.name == "syncwatch_build_info" or sample.labels["rig"] == "bench"
            labels = tuple(value for name, value in sorted(sample.labels.items()) if name != "rig")
            found[(sample.name.removeprefix("syncwatch_"), *labels)] = sample.value
    return found


def test_pairs_are_told_in_base_units(sink):
    sink.take(STATUS)
    told = scraped(sink)
    assert told["offset_seconds", "left-right"] == 0.0333
    assert told["offset_sigma_seconds", "left-right"] == 0.0006
    assert told["skew_p99_seconds", "left-right"] == 0.033
    assert told["drift_ratio", "left-right", "stamps"] == pytest.approx(50e-6)
    assert told["drift_sigma_ratio", "left-right", "pictures"] == pytest.approx(3e-6)
    assert told["coverage_ratio", "left-right"] == 0.98
    assert told["state_since_timestamp_seconds", "left-right"] == 5


def test_states_levels_and_causes_are_one_hot(sink):
    sink.take(STATUS)
    told = scraped(sink)
    assert {state.value: told["state", "left-right", state.value] for state in State} == {
        "sync": 0, "async": 1, "unknown": 0
    }  # fmt: skip
    assert [told["level", level.value] for level in Level] == [0, 0, 1, 0]
    assert {key: value for key, value in told.items() if key[0] == "cause" and value} == {
        ("cause", "slip", "left-right"): 1
    }
    sink.take(replace(STATUS, level=Level.OK, pairs={"left-right": replace(PAIR, state=State.SYNC, cause=None)}))
    told = scraped(sink)
    assert [told["level", level.value] for level in Level] == [1, 0, 0, 0]
    assert not any(value for key, value in told.items() if key[0] == "cause")


def test_cameras_and_the_monitor_are_told(sink):
    sink.take(STATUS)
    told = scraped(sink)
    assert (told["frames_total", "left"], told["drops_total", "left"], told["stalls_total", "left"]) == (900, 3, 2)
    assert (told["frame_rate_hertz", "left"], told["expected_frame_rate_hertz", "left"]) == (29.9, 30)
    assert told["jitter_p99_seconds", "left"] == 0.0002
    assert [name for (kind, *name), value in told.items() if kind == "camera_condition" and value] == [
        ["left", "dark"], ["right", "frozen"], ["right", "missing"]
    ]  # fmt: skip
    assert told["verdict_latency_p99_seconds",] == 0.04
    assert told["resident_memory_bytes",] == 123e6
    assert told["dropped_windows_total",] == 6
    assert (told["sink_dropped_reports_total", "zenoh"], told["sink_dropped_frames_total", "zenoh"]) == (7, 8)
    assert told["build_info", "1.2"] == 1


def test_what_is_unknown_is_left_out(sink):
    unknown = PairStatus(State.UNKNOWN, None, 0, None, None, 0.0)
    sink.take(replace(STATUS, pairs={"left-right": unknown}, latency_p99_ns=None, memory_bytes=None))
    told = scraped(sink)
    left_out = {
        "offset_seconds",
        "skew_p99_seconds",
        "drift_ratio",
        "verdict_latency_p99_seconds",
        "resident_memory_bytes",
    }
    assert not left_out & {key[0] for key in told}
    assert told["state", "left-right", "unknown"] == 1


def test_verdicts_and_onsets_are_counted(sink):
    for report in (VERDICT, VERDICT, replace(VERDICT, state=State.SYNC), EVENT, replace(EVENT, phase="end")):
        sink.take(report)
    told = scraped(sink)
    assert (told["verdicts_total", "left-right", "async"], told["verdicts_total", "left-right", "sync"]) == (2, 1)
    assert told["events_total", "slip", "async"] == 1


def test_names_that_need_quoting_do_not_break_the_page():
    sink = PrometheusSink(PrometheusSettings(listen="127.0.0.1:0"), rig='a"b\\c', version="0")
    sink.start()
    sink.take(STATUS)
    labels = [
        sample.labels
        for family in text_string_to_metric_families(fetched(sink.url)[1])
        for sample in family.samples
        if sample.name == "syncwatch_uptime_seconds"
    ]
    sink.stop()
    assert labels == [{"rig": 'a"b\\c'}]


def test_open_metrics_is_spoken_where_asked_for(sink):
    sink.take(STATUS)
    kind, text = fetched(sink.url, "application/openmetrics-text; version=1.0.0")
    assert kind.startswith("application/openmetrics-text")
    assert text.endswith("# EOF\n")


@pytest.mark.parametrize(("path", "status"), [("/", 404), ("/metrics/x", 404), ("/metrics?name=a", 200)])
def test_only_metrics_are_answered(sink, path, status):
    connection = http.client.HTTPConnection(sink.url.split("/")[2], timeout=5)
    connection.request("GET", path)
    assert connection.getresponse().status == status
    connection.close()


def test_counters_grow_on_when_a_camera_comes_back_anew():
    """A device that starts again counts from zero with a new clock; what is told of it goes on."""
    sink, monitor, seen = made(), Monitor(), []
    sink.start()
    for items in (stereo(40), stereo(10, 45, epoch=1), stereo(30, 60, epoch=2)):
        for item in items:
            monitor.take(replace(item, sequence=item.sequence % 45) if item.epoch else item)
        sink.take(monitor.status())
        told = scraped(sink)
        seen.append([told[name, "right"] for name in ("frames_total", "drops_total", "restarts_total")])
    sink.stop()
    assert [row[0] for row in seen] == [40, 50, 80]
    assert [row[2] for row in seen] == [0, 1, 2]
    assert [row[1] for row in seen] == sorted(row[1] for row in seen)


def test_a_port_that_is_taken_is_one_line(sink, tmp_path):
    port = int(sink.url.split(":")[2].split("/")[0])
    with pytest.raises(InputError, match=rf"prometheus: cannot listen at 127.0.0.1:{port}: Address already in use; "):
        made(listen=f"127.0.0.1:{port}").start()
    (tmp_path / "c.yaml").write_text("source: {type: synthetic}\ndetectors: {timestamp: }\n")
    done = inside("run", "c.yaml", "--set", f"sinks={{prometheus: {{listen: '127.0.0.1:{port}'}}}}", cwd=tmp_path)
    assert (done.returncode, len(done.stderr.splitlines())) == (2, 1), done.stderr


@pytest.mark.parametrize("listen", ["9464", ":9464", "a:b", "127.0.0.1:70000", "http://a:1", "a b:1"])
def test_an_address_that_is_none_is_refused(listen):
    with pytest.raises(ValidationError, match=r"is not an address: write it like 127\.0\.0\.1:9464"):
        PrometheusSettings(listen=listen)


def test_a_host_that_is_not_here_is_refused():
    with pytest.raises(InputError, match=r"cannot listen at 192\.0\.2\.1:9464: "):
        made(listen="192.0.2.1:9464").start()


def test_it_stops_at_once_and_frees_its_port_though_a_client_hangs():
    sink = made()
    sink.start()
    port = int(sink.url.split(":")[2].split("/")[0])
    with socket.create_connection(("127.0.0.1", port)) as hanging:
        hanging.sendall(b"GET /metr")
        stopper = threading.Thread(target=sink.stop)
        stopper.start()
        stopper.join(2)
        assert not stopper.is_alive()
    again = made(listen=f"127.0.0.1:{port}")
    again.start()
    again.stop()


def test_scrapes_while_reports_come_are_whole(sink):
    stopped = threading.Event()

    def report() -> None:
        while not stopped.is_set():
            sink.take(STATUS)
            sink.take(VERDICT)
            time.sleep(0)

    reporter = threading.Thread(target=report)
    reporter.start()
    counts = [scraped(sink).get(("verdicts_total", "left-right", "async"), 0) for _ in range(10)]
    stopped.set()
    reporter.join()
    assert counts == sorted(counts)


def exprs() -> dict[str, str]:
    (group,) = yaml.safe_load(ALERTS.read_text())["groups"]
    return {rule["alert"]: rule["expr"] for rule in group["rules"]}


def test_every_metric_and_label_of_the_alerts_exists(sink):
    for report in (STATUS, VERDICT, EVENT):
        sink.take(report)
    samples = [s for family in text_string_to_metric_families(fetched(sink.url)[1]) for s in family.samples]
    for alert, expr in exprs().items():
        named = re.findall(r"(syncwatch_\w+)(?:\{(\w+)=(~?)\"([^\"]+)\"\})?", expr)
        assert named or expr == 'up{job="syncwatch"} == 0', alert
        for name, label, loose, value in named:
            wanted = value.split("|") if loose else [value]
            for one in wanted:
                matching = [s for s in samples if s.name == name and (not label or s.labels.get(label) == one)]
                assert matching, (alert, name, label, one)


needs_promtool = pytest.mark.skipif(
    PROMTOOL is None, reason="promtool is not installed (Debian's package prometheus has it)"
)


def promtool(*arguments: str, stdin: str | None = None) -> str:
    assert PROMTOOL is not None
    done = subprocess.run([PROMTOOL, *arguments], input=stdin, capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout + done.stderr


@needs_promtool
def test_promtool_accepts_the_rules_and_the_configuration():
    assert f"{len(exprs())} rules found" in promtool("check", "rules", str(ALERTS))
    promtool("check", "config", str(ALERTS.parent / "prometheus.yml"))


@needs_promtool
def test_promtool_has_nothing_against_the_names_of_the_metrics(sink):
    for report in (STATUS, VERDICT, EVENT):
        sink.take(report)
    assert promtool("check", "metrics", stdin=fetched(sink.url)[1]) == ""


@needs_promtool
def test_alerts_fire_when_they_should(tmp_path):
    series = {
        'syncwatch_state{rig="bench",pair="l-r",state="async"}': "0x3 1x20",
        'syncwatch_drops_total{rig="bench",camera="l"}': "0+3x200",
        'syncwatch_frames_total{rig="bench",camera="l"}': "0+150x200",
        'syncwatch_drops_total{rig="bench",camera="r"}': "0+1x200",
        'syncwatch_frames_total{rig="bench",camera="r"}': "0+150x200",
        'syncwatch_status_timestamp_seconds{rig="bench"}': "0x200",
    }

    def fires(alert: str, at: str, **labels: str) -> dict[str, Any]:
        return {"eval_time": at, "alertname": alert, "exp_alerts": [{"exp_labels": labels}] if labels else []}

    cases = {
        "rule_files": [str(ALERTS)],
        "evaluation_interval": "5s",
        "tests": [
            {
                "interval": "5s",
                "input_series": [{"series": name, "values": values} for name, values in series.items()],
                "alert_rule_test": [
                    fires("SyncwatchOutOfSync", "15s"),
                    fires("SyncwatchOutOfSync", "40s", severity="critical", rig="bench", pair="l-r", state="async"),
                    fires("SyncwatchFramesLost", "12m", severity="warning", rig="bench", camera="l"),
                    fires("SyncwatchMonitorStuck", "10s"),
                    fires("SyncwatchMonitorStuck", "30s", severity="critical", rig="bench"),
                ],
            }
        ],
    }
    for case in cases["tests"][0]["alert_rule_test"]:
        for alert in case["exp_alerts"]:
            (rule,) = (
                r for r in yaml.safe_load(ALERTS.read_text())["groups"][0]["rules"] if r["alert"] == case["alertname"]
            )
            text = rule["annotations"]["summary"]
            for name, value in alert["exp_labels"].items():
                text = text.replace("{{ $labels." + name + " }}", value)
            alert["exp_annotations"] = {"summary": text.replace("{{ $value }}", "30")}
    (tmp_path / "cases.yaml").write_text(yaml.safe_dump(cases))
    assert "SUCCESS" in promtool("test", "rules", str(tmp_path / "cases.yaml"))
