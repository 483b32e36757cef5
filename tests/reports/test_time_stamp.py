"""A time-stamping authority confirms the head of the audit trail; its stamp reveals a trail that was cut later."""

import threading
from collections.abc import Iterator
from datetime import UTC, datetime, timedelta
from http.server import BaseHTTPRequestHandler, HTTPServer
from pathlib import Path

import pytest
from asn1crypto import keys, tsp
from asn1crypto import x509 as asn1
from cryptography import x509
from cryptography.hazmat.primitives import hashes
from cryptography.hazmat.primitives.asymmetric import rsa
from cryptography.hazmat.primitives.serialization import Encoding, NoEncryption, PrivateFormat
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID
from pyhanko.sign.timestamps import DummyTimeStamper

from calstation.cli.app import run_app
from calstation.records import append_audit, audit_path, restart_trail


@pytest.fixture(scope="module")
def authority() -> Iterator[str]:
    """The address of an authority on this computer."""
    key = rsa.generate_private_key(65537, 2048)
    name = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, "Time authority")])
    now = datetime.now(UTC)
    usage = dict.fromkeys(
        ("key_encipherment", "data_encipherment", "key_agreement", "key_cert_sign", "crl_sign"), False
    ) | dict.fromkeys(("encipher_only", "decipher_only", "content_commitment"), False)
    builder = x509.CertificateBuilder().subject_name(name).issuer_name(name).public_key(key.public_key())
    builder = builder.serial_number(x509.random_serial_number())
    builder = builder.not_valid_before(now - timedelta(days=1)).not_valid_after(now + timedelta(days=1))
    builder = builder.add_extension(x509.KeyUsage(digital_signature=True, **usage), critical=True)
    builder = builder.add_extension(x509.ExtendedKeyUsage([ExtendedKeyUsageOID.TIME_STAMPING]), critical=True)
    certificate = builder.sign(key, hashes.SHA256()).public_bytes(Encoding.DER)
    private = key.private_bytes(Encoding.DER, PrivateFormat.PKCS8, NoEncryption())
    stamper = DummyTimeStamper(asn1.Certificate.load(certificate), keys.PrivateKeyInfo.load(private))

    class Handler(BaseHTTPRequestHandler):
        def do_POST(self) -> None:
            request = tsp.TimeStampReq.load(self.rfile.read(int(self.headers["Content-Length"])))
            if self.path == "/other":
                request["message_imprint"]["hashed_message"] = bytes(32)
            content = stamper.request_tsa_response(request).dump()
            self.send_response(200 if self.path != "/out-of-service" else 503)
            self.send_header("Content-Type", "application/timestamp-reply")
            self.send_header("Content-Length", str(len(content)))
            self.end_headers()
            self.wfile.write(content)

        def log_message(self, *_: object) -> None:
            pass

    server = HTTPServer(("127.0.0.1", 0), Handler)
    thread = threading.Thread(target=server.serve_forever)
    thread.start()
    yield f"http://127.0.0.1:{server.server_port}/"
    server.shutdown()
    thread.join()
    server.server_close()


@pytest.fixture(autouse=True)
def site(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("CALSTATION_HOME", str(tmp_path))
    return tmp_path


def test_stamp_is_found_in_a_longer_trail_and_in_a_former_one(
    site: Path, authority: str, capsys: pytest.CaptureFixture[str]
) -> None:
    append_audit(site, "override", "li", "scratch")
    append_audit(site, "override", "li", "dent")
    assert run_app(["audit", "--timestamp", authority]) == 0
    assert "Time authority" in (text := " ".join(capsys.readouterr().out.split()))
    assert "confirms that line 2 of" in text
    stamp = site / "audit_line_2.tst"
    append_audit(site, "override", "li", "scratch")
    assert run_app(["check", str(stamp)]) == 0
    restart_trail(site, "li", "key lost", None)
    assert run_app(["check", str(stamp)]) == 0


def test_stamp_reveals_a_trail_that_was_written_anew(site: Path, authority: str) -> None:
    append_audit(site, "override", "li", "to be hidden")
    assert run_app(["audit", "--timestamp", authority]) == 0
    for path in (audit_path(site), site / "station.key", site / "station.head"):
        path.unlink()
    append_audit(site, "override", "li", "harmless")
    assert run_app(["check"]) == 0
    assert run_app(["check", str(site / "audit_line_1.tst")]) == 2


def test_every_byte_of_a_stamp_is_covered_or_changes_nothing(
    site: Path, authority: str, capsys: pytest.CaptureFixture[str]
) -> None:
    append_audit(site, "override", "li", "scratch")
    assert run_app(["audit", "--timestamp", authority]) == 0
    expected, stamp = capsys.readouterr().out, site / "audit_line_1.tst"
    content = stamp.read_bytes()
    for i in range(0, len(content), 80):
        stamp.write_bytes(content[:i] + bytes([content[i] ^ 1]) + content[i + 1 :])
        code = run_app(["check", str(stamp)])
        assert code == 2 or capsys.readouterr().out == expected, i


def test_nothing_is_stamped_without_a_trail_or_an_authority(
    site: Path, authority: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run_app(["audit", "--timestamp", authority]) == 2
    append_audit(site, "override", "li", "scratch")
    for url in (f"{authority}other", f"{authority}out-of-service", "http://127.0.0.1:1/", "nonsense"):
        assert run_app(["audit", "--timestamp", url]) == 2
        assert "does not answer or refuses" in " ".join(capsys.readouterr().err.split())
    assert not list(site.glob("*.tst"))
