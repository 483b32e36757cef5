"""Processes for tests without their start-up time, forked from servers that have imported all modules.

Every test still has its own virtual bench and engine, started and ended as usual; only importing and loading
compiled code, which takes seconds, is done once. Without `os.fork`, real processes are started.

    python tests/lent.py SOCKET OWNER      the server of bench processes, until the process OWNER has ended
"""

import fcntl
import json
import multiprocessing
import os
import signal
import socket
import subprocess
import sys
import threading
import time
import traceback
from contextlib import suppress
from multiprocessing import forkserver
from multiprocessing.context import ForkServerContext, ForkServerProcess
from pathlib import Path
from types import ModuleType
from typing import IO, Any

#: Names the server's socket to this process and the engines that it starts.
_SOCKET = "CALSTATION_TEST_BENCHES"
_BENCH = ["-m", "calstation.bench"]
_POLL = 0.005
#: The server's process where this one started it.
_started: list[subprocess.Popen[bytes]] = []

os.environ.setdefault("CALSTATION_LOG_FOLDER", "")  # tests keep no application log


class LentBench:
    """A bench process, as `subprocess.Popen` would have started it."""

    def __init__(self, args: list[str], *, stderr: bool) -> None:
        self.args = args
        self.returncode: int | None = None
        self._line = _connect(Path(os.environ[_SOCKET]))
        (inner, stdin), (stdout, outer) = os.pipe(), os.pipe()
        errors, error_end = os.pipe() if stderr else (None, os.dup(2))
        theirs = [inner, outer, error_end]
        request = {"args": args[len(_BENCH) + 1 :], "cwd": str(Path.cwd()), "environment": dict(os.environ)}
        text = json.dumps(request).encode()
        socket.send_fds(self._line, [len(text).to_bytes(4, "big")], theirs)
        self._line.sendall(text)
        for descriptor in theirs:
            os.close(descriptor)
        self.stdin: IO[bytes] = os.fdopen(stdin, "wb", buffering=0)
        self.stdout: IO[bytes] = os.fdopen(stdout, "rb", buffering=0)
        self.stderr: IO[bytes] | None = None if errors is None else os.fdopen(errors, "rb", buffering=0)
        self.pid = int(_read(self._line, 8))

    def poll(self) -> int | None:
        """Return the exit code, None while the process is running."""
        if self.returncode is None:
            self._line.setblocking(False)
            with suppress(BlockingIOError):
                self._end()
        return self.returncode

    def wait(self, timeout: float | None = None) -> int:
        """Wait for the end."""
        if self.returncode is None:
            self._line.settimeout(timeout)
            try:
                self._end()
            except TimeoutError:
                raise subprocess.TimeoutExpired(self.args, timeout or 0.0) from None
        assert self.returncode is not None
        return self.returncode

    def send_signal(self, number: int) -> None:
        """Send a signal to the process if it is running."""
        if self.poll() is None:
            with suppress(ProcessLookupError):  # the server has reaped it, its exit code is on its way
                os.kill(self.pid, number)

    def kill(self) -> None:
        """Kill the process."""
        self.send_signal(signal.SIGKILL)

    def communicate(self) -> tuple[bytes, bytes]:
        """Close the input and return the rest of both outputs."""
        self.stdin.close()
        left = self.stdout.read(), self.stderr.read() if self.stderr is not None else b""
        self.stdout.close()
        if self.stderr is not None:
            self.stderr.close()
        self.wait()
        return left

    def _end(self) -> None:
        answer = _read(self._line, 8)
        self._line.close()
        self.returncode = int(answer)


class _EngineProcess(ForkServerProcess):
    """A forked process with the environment of its parent at its start, like a spawned process."""

    def start(self) -> None:
        self._environment = dict(os.environ)
        super().start()

    def _bootstrap(self, *args: Any, **kwargs: Any) -> int:
        os.environ.clear()
        os.environ.update(self._environment)
        return int(super()._bootstrap(*args, **kwargs))


class _EngineContext(ForkServerContext):
    Process = _EngineProcess  # type: ignore[assignment]


def install() -> None:
    """Make this process, and the engines that it starts, use forked processes.

    All workers of a test session share the server of benches, which lives as long as the process that started them.
    """
    if not hasattr(os, "fork") or "forkserver" not in multiprocessing.get_all_start_methods():
        return
    owner = os.getppid() if "PYTEST_XDIST_WORKER" in os.environ else os.getpid()
    path = Path("/tmp") / f"calstation-benches-{owner}"
    lend_benches(path)
    # Both servers take long to import everything on a busy computer, and an engine is expected to begin soon.
    threading.Thread(target=lambda: _connect(path).close(), daemon=True).start()
    engines = _EngineContext()
    engines.set_forkserver_preload(["lent_engine"])  # found by this path; an import that fails is silent
    here = str(Path(__file__).parent)
    os.environ["PYTHONPATH"] = os.pathsep.join(filter(None, (here, os.environ.get("PYTHONPATH"))))
    forkserver.ensure_running()
    real = multiprocessing.get_context

    def get_context(method: str | None = None) -> Any:
        return engines if method == "spawn" and not _needs_own_process() else real(method)

    multiprocessing.get_context = get_context  # type: ignore[assignment]


def lend_benches(path: Path | None = None) -> None:
    """Fork benches started by this process from the server at `path`, or from the inherited server."""
    if path is not None:
        os.environ[_SOCKET] = str(path)
    from calstation.bench import client

    shim = ModuleType("subprocess")
    shim.__dict__.update(subprocess.__dict__)
    shim.Popen = popen  # type: ignore[attr-defined]
    client.subprocess = shim  # type: ignore[assignment]


def popen(args: list[str], **options: Any) -> Any:
    """Replace `subprocess.Popen`, with forked benches."""
    if args[1 : 1 + len(_BENCH)] == _BENCH and _SOCKET in os.environ and not _needs_own_process():
        return LentBench(args, stderr=options.get("stderr") == subprocess.PIPE)
    return subprocess.Popen(args, **options)


def _needs_own_process() -> bool:
    """Return whether processes load a library at their start, which a fork does not."""
    return "LD_PRELOAD" in os.environ


def _connect(path: Path) -> socket.socket:
    """Return a connection to the server, which is started if necessary."""
    with path.with_suffix(".lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        line = _try(path)
        if line is None:
            owner = path.name.rpartition("-")[2]
            command = [sys.executable, __file__, str(path), owner]
            # Without this process's descriptors, which would stay open as long as the server.
            server = subprocess.Popen(command, start_new_session=True)
            _started.append(server)
            while (line := _try(path)) is None:
                if server.poll() is not None:
                    raise RuntimeError(f"the server of benches ended with exit code {server.returncode}")
                time.sleep(_POLL)
        return line


def _try(path: Path) -> socket.socket | None:
    line = socket.socket(socket.AF_UNIX)
    try:
        line.connect(str(path))
    except OSError:
        line.close()
        return None
    return line


def _read(line: socket.socket, count: int) -> bytes:
    """Read exactly `count` bytes; a closed connection is the exit code of a process killed with its supervisor."""
    data = b""
    while len(data) < count:
        more = line.recv(count - len(data))
        if not more:
            return b"-9"
        data += more
    return data


def _serve(path: Path, owner: int) -> None:
    """Fork a bench for every connection, until the owner has ended."""
    from calstation.bench import BenchConfig
    from calstation.bench import __main__ as bench
    from calstation.bench.process import warm_up

    warm_up(BenchConfig())
    path.unlink(missing_ok=True)
    server = socket.socket(socket.AF_UNIX)
    server.bind(str(path))
    server.listen()
    server.settimeout(1.0)
    while _lives(owner):
        try:
            line, _ = server.accept()
        except TimeoutError:
            continue
        finally:
            _reap()
        if os.fork() == 0:
            server.close()
            _keep(line, bench.main)
        line.close()
    path.unlink(missing_ok=True)
    path.with_suffix(".lock").unlink(missing_ok=True)


def _keep(line: socket.socket, main: Any) -> None:
    """Run between server and bench: start the bench, send its process id, and its exit code at the end."""
    size, descriptors, _, _ = socket.recv_fds(line, 4, 3)
    if not size:  # only asked whether the server is there
        os._exit(0)
    request = json.loads(_read(line, int.from_bytes(size, "big")))
    pid = os.fork()
    if pid == 0:
        line.close()
        for number, descriptor in enumerate(descriptors):
            os.dup2(descriptor, number)
            os.close(descriptor)
        code = 1
        try:
            os.chdir(request["cwd"])
            os.environ.clear()
            os.environ.update(request["environment"])
            sys.argv = ["calstation.bench", *request["args"]]
            sys.stdin, sys.stdout, sys.stderr = os.fdopen(0), os.fdopen(1, "w"), os.fdopen(2, "w")
            code = main()
        except SystemExit as end:
            code = int(end.code or 0)
        except BaseException:  # noqa: BLE001 - as the interpreter itself would
            traceback.print_exc()
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)
    for descriptor in descriptors:
        os.close(descriptor)
    line.sendall(b"%8d" % pid)
    _, status = os.waitpid(pid, 0)
    with suppress(OSError):
        line.sendall(b"%8d" % os.waitstatus_to_exitcode(status))
    os._exit(0)


def _reap() -> None:
    """Wait for the processes that have ended; ignoring their signal would lose their CPU time."""
    with suppress(ChildProcessError):
        while os.waitpid(-1, os.WNOHANG)[0]:
            pass


def _lives(process: int) -> bool:
    try:
        os.kill(process, 0)
    except OSError:
        return False
    return True


if __name__ == "__main__":
    _serve(Path(sys.argv[1]), int(sys.argv[2]))
