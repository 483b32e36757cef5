"""Another program reads the corrected data of `calstation watch` over a socket."""

import json
import os
import re
import socket
import subprocess
import sys
from pathlib import Path

import pytest


@pytest.mark.long
def test_another_program_reads_corrected_data_while_a_log_is_replayed(tmp_path: Path) -> None:
    log, written = tmp_path / "pair.h5", tmp_path / "corrected.jsonl"
    command = [sys.executable, "-m", "calstation"]
    home = {**os.environ, "CALSTATION_HOME": str(tmp_path / "home"), "PYTHONUNBUFFERED": "1"}
    subprocess.run([*command, "record", "pair", "-o", log, "--seed", "3"], check=True, env=home)
    options = ["--pairs", tmp_path / "pairs", "--serve", "127.0.0.1:0", "-o", written]
    with subprocess.Popen([*command, "watch", log, *options], stdout=subprocess.PIPE, text=True, env=home) as watch:
        assert watch.stdout is not None
        found = re.search(r"served on 127\.0\.0\.1:(\d+)\.", watch.stdout.readline())
        assert found is not None
        with (
            socket.create_connection(("127.0.0.1", int(found[1])), timeout=60.0) as client,
            client.makefile() as stream,
        ):
            received = stream.read().splitlines()
        assert "imu2 calibrated" in watch.stdout.read()
    assert watch.returncode == 0
    lines = [json.loads(line) for line in received]
    data = [line for line in lines if line["type"] == "data"]
    assert not any(line["type"] == "dropped" for line in lines)
    assert [line["seq"] + line["count"] for line in data[:-1]] == [line["seq"] for line in data[1:]]
    assert {line["imu2"]["calibration"] for line in data} == {0, 1}
    assert (lines[0]["type"], lines[-1]["type"]) == ("start", "end")
    assert written.read_text().splitlines() == received
