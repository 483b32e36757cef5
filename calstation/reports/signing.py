"""Signatures with a certificate of the site: PAdES for a PDF, and XAdES for a digital calibration certificate.

A signature contains its time, so that the bytes differ each time the same document is signed.
"""

import io
import os
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from lxml import etree

from calstation.errors import ConfigurationError
from calstation.messages import os_reason

if TYPE_CHECKING:
    from cryptography.hazmat.primitives.asymmetric.ec import EllipticCurvePrivateKey
    from cryptography.hazmat.primitives.asymmetric.rsa import RSAPrivateKey
    from cryptography.x509 import Certificate
    from pyhanko.sign import SimpleSigner

#: Environment variable that contains the password of the certificate file.
PASSWORD_VARIABLE = "CALSTATION_SIGNING_PASSWORD"
#: Service and user name of the password in the keyring of the operating system.
KEYRING = ("calstation", "signing")


@dataclass(frozen=True)
class Signer:
    """A private key and its certificates; the first one belongs to the signer."""

    key: "RSAPrivateKey | EllipticCurvePrivateKey"
    certificates: "list[Certificate]"
    for_pdf: "SimpleSigner"


def load_signer(file: Path) -> Signer:
    """Read a PKCS #12 file, whose password is in the environment or in the keyring, never in a file.

    Raises ConfigurationError if the extra ``signing`` is not installed, if there is no password, or if the file cannot
    be read or has no RSA or elliptic-curve key.
    """
    try:
        from cryptography.hazmat.primitives.asymmetric import ec, rsa
        from cryptography.hazmat.primitives.serialization import pkcs12
        from pyhanko.sign import SimpleSigner
    except ImportError as exc:
        raise ConfigurationError("signing.not_installed") from exc
    try:
        content = file.read_bytes()
    except OSError as exc:
        raise ConfigurationError("signing.unreadable", file=file, reason=os_reason(exc)) from exc
    password = _password()
    if password is None:
        raise ConfigurationError("signing.no_password", file=file, variable=PASSWORD_VARIABLE)
    try:
        key, certificate, others = pkcs12.load_key_and_certificates(content, password.encode())
    except ValueError as exc:
        raise ConfigurationError("signing.not_opened", file=file) from exc
    if certificate is None or not isinstance(key, rsa.RSAPrivateKey | ec.EllipticCurvePrivateKey):
        raise ConfigurationError("signing.no_key", file=file)
    for_pdf = SimpleSigner.load_pkcs12_data(content, other_certs=[], passphrase=password.encode())
    return Signer(key, [certificate, *others], for_pdf)


def _password() -> str | None:
    import keyring
    import keyring.errors

    if PASSWORD_VARIABLE in os.environ:
        return os.environ[PASSWORD_VARIABLE]
    try:
        return keyring.get_password(*KEYRING)
    except keyring.errors.KeyringError:
        return None


def sign_pdf(pdf: bytes, signer: Signer) -> bytes:
    """Return a PDF with an invisible signature in an incremental update, which preserves PDF/A and attachments."""
    from pyhanko.pdf_utils.incremental_writer import IncrementalPdfFileWriter
    from pyhanko.sign import PdfSignatureMetadata
    from pyhanko.sign import sign_pdf as sign
    from pyhanko.sign.fields import SigSeedSubFilter

    class Writer(IncrementalPdfFileWriter):
        """Leaves metadata and version unchanged, because the changes of the library do not conform to PDF/A-3."""

        def _update_meta(self) -> None:
            pass

        def ensure_output_version(self, version: tuple[int, int]) -> None:
            pass

    settings = PdfSignatureMetadata("Signature", md_algorithm="sha256", subfilter=SigSeedSubFilter.PADES)
    signed = io.BytesIO()
    sign(Writer(io.BytesIO(pdf)), settings, signer.for_pdf, output=signed)
    return signed.getvalue()


def sign_xml(xml: bytes, signer: Signer) -> bytes:
    """Return an XML document with an enveloped signature at the end of the root, as the DCC schema requires."""
    from cryptography.hazmat.primitives.asymmetric.rsa import RSAPrivateKey
    from signxml.algorithms import SignatureMethod
    from signxml.xades.xades import XAdESSigner

    rsa = isinstance(signer.key, RSAPrivateKey)
    method = SignatureMethod.RSA_SHA256 if rsa else SignatureMethod.ECDSA_SHA256
    root = XAdESSigner(signature_algorithm=method).sign(etree.fromstring(xml), key=signer.key, cert=signer.certificates)
    return etree.tostring(root, xml_declaration=True, encoding="UTF-8") + b"\n"
