"""A script without a `__main__` guard can start processes of the package."""

import subprocess
import sys

SCRIPT = """
import time
from calstation.jobs.queue import JobQueue

print("once")
workshop = JobQueue()
job = workshop.submit(len, "abc")
while job.state in ("waiting", "running"):
    job.poll()
    time.sleep(0.01)
print(job.state)
workshop.close()
"""


def test_script_without_a_main_guard_is_not_executed_again(tmp_path):
    script = tmp_path / "script.py"
    script.write_text(SCRIPT, encoding="utf-8")
    done = subprocess.run([sys.executable, script], capture_output=True, text=True, timeout=60, check=False)
    assert done.stdout.split() == ["once", "failed"], done.stderr
    assert "bootstrapping" not in done.stderr
