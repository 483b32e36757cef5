"""A signed report verifies and stays PDF/A; a modified report does not verify."""

import io
import sys
from pathlib import Path

import keyring
import keyring.errors
import pytest
import typst
from cryptography.hazmat.primitives.asymmetric import ed25519
from cryptography.hazmat.primitives.serialization import Encoding
from lxml import etree
from pyhanko.keys import load_certs_from_pemder_data
from pyhanko.pdf_utils.reader import PdfFileReader
from pyhanko.sign.validation import PdfSignatureStatus, validate_pdf_signature
from pyhanko_certvalidator import ValidationContext
from signxml.exceptions import InvalidDigest, InvalidSignature
from signxml.xades.xades import XAdESVerifier

from calstation.errors import ConfigurationError
from calstation.reports.signing import KEYRING, PASSWORD_VARIABLE, Signer, load_signer, sign_pdf, sign_xml
from tests.helpers import raises_code
from tests.reports.seal import KEYS, PASSWORD, write_certificate

XML = b"<?xml version='1.0' encoding='UTF-8'?>\n<certificate><value>1.25e-06</value></certificate>\n"


@pytest.fixture(scope="module", params=["rsa", "ec"])
def file(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The signing certificate of the site."""
    return write_certificate(tmp_path_factory.mktemp("site") / "seal.p12", KEYS[request.param]())


@pytest.fixture
def signer(file: Path, monkeypatch: pytest.MonkeyPatch) -> Signer:
    """The signer of the site."""
    monkeypatch.setenv(PASSWORD_VARIABLE, PASSWORD)
    return load_signer(file)


@pytest.fixture(scope="module")
def pdf() -> bytes:
    """A PDF/A-3b with an attachment."""
    options = 'relationship: "data", mime-type: "text/xml", description: "DCC"'
    source = f'#set document(title: "T")\n#pdf.attach("dcc.xml", bytes("<dcc/>"), {options})\nReport'
    built = typst.compile(source.encode(), pdf_standards=["a-3b"], timestamp=0)
    assert isinstance(built, bytes)
    return built


def checked(signed: bytes, signer: Signer) -> PdfSignatureStatus:
    """Return the validation result of a reader that trusts the certificate of the site."""
    (root,) = load_certs_from_pemder_data(signer.certificates[0].public_bytes(Encoding.DER))
    (signature,) = PdfFileReader(io.BytesIO(signed)).embedded_signatures
    return validate_pdf_signature(signature, ValidationContext(trust_roots=[root]))


def test_a_signed_pdf_verifies(pdf: bytes, signer: Signer) -> None:
    status = checked(sign_pdf(pdf, signer), signer)
    assert status.bottom_line
    assert status.trusted
    assert status.coverage.name == "ENTIRE_FILE"


def test_modified_pdf_does_not_verify(pdf: bytes, signer: Signer) -> None:
    signed = bytearray(sign_pdf(pdf, signer))
    signed[signed.index(b"xmpmeta") - 4] ^= 1
    status = checked(bytes(signed), signer)
    assert not status.intact
    assert not status.bottom_line


def test_signature_preserves_pdf_a_and_attachments(pdf: bytes, signer: Signer) -> None:
    """The document is unchanged before the signature, whose field is printed and not hidden, as PDF/A requires."""
    signed = sign_pdf(pdf, signer)
    assert signed.startswith(pdf)
    before, after = (PdfFileReader(io.BytesIO(content)) for content in (pdf, signed))
    assert after.root["/Metadata"].data == before.root["/Metadata"].data
    assert b"<pdfaid:part>3</pdfaid:part>" in after.root["/Metadata"].data
    assert after.root["/Names"]["/EmbeddedFiles"] == before.root["/Names"]["/EmbeddedFiles"]
    assert after.root["/AF"] == before.root["/AF"]
    assert after.input_version == before.input_version == (1, 7)
    assert "/Version" not in after.root
    assert after.trailer["/Info"] == before.trailer["/Info"]
    (field,) = (entry.get_object() for entry in after.root["/AcroForm"]["/Fields"])
    assert field["/F"] & 0b111111 == 0b000100
    assert field["/Rect"][0] == field["/Rect"][2]


def test_a_signed_xml_verifies(signer: Signer) -> None:
    signed = sign_xml(XML, signer)
    root = etree.fromstring(signed)
    assert [etree.QName(child).localname for child in root] == ["value", "Signature"]
    results = XAdESVerifier().verify(signed, x509_cert=signer.certificates[0])
    seen = [result.signed_xml for result in results if result.signed_xml is not None]
    assert seen[0].findtext("value") == "1.25e-06"


def test_modified_xml_does_not_verify(signer: Signer) -> None:
    signed = sign_xml(XML, signer).replace(b"1.25e-06", b"1.26e-06")
    with pytest.raises((InvalidDigest, InvalidSignature)):
        XAdESVerifier().verify(signed, x509_cert=signer.certificates[0])


def test_password_is_read_from_the_keyring(file: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(PASSWORD_VARIABLE, raising=False)
    monkeypatch.setattr(keyring, "get_password", lambda *name: PASSWORD if name == KEYRING else None)
    assert load_signer(file).certificates[0].subject.rfc4514_string() == "CN=Inertial laboratory"


def test_without_a_password_nothing_is_signed(file: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def no_keyring(*_: str) -> None:
        raise keyring.errors.NoKeyringError

    monkeypatch.delenv(PASSWORD_VARIABLE, raising=False)
    monkeypatch.setattr(keyring, "get_password", no_keyring)
    with raises_code(ConfigurationError, "signing.no_password") as caught:
        load_signer(file)
    assert PASSWORD_VARIABLE in str(caught.value)


def test_a_wrong_password_is_refused(file: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(PASSWORD_VARIABLE, "wrong")
    with raises_code(ConfigurationError, "signing.not_opened"):
        load_signer(file)


def test_missing_certificate_is_reported(tmp_path: Path) -> None:
    with raises_code(ConfigurationError, "signing.unreadable") as caught:
        load_signer(tmp_path / "seal.p12")
    assert "seal.p12" in str(caught.value)


def test_unsupported_key_type_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(PASSWORD_VARIABLE, PASSWORD)
    other = write_certificate(tmp_path / "seal.p12", ed25519.Ed25519PrivateKey.generate())
    with raises_code(ConfigurationError, "signing.no_key"):
        load_signer(other)


def test_missing_optional_dependency_is_reported_with_its_installation(
    file: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "pyhanko.sign", None)
    with raises_code(ConfigurationError, "signing.not_installed") as caught:
        load_signer(file)
    assert "pip install 'calstation[signing]'" in str(caught.value)
