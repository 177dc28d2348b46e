"""A certificate for this computer that only its maker trusts, made by openssl."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

OPENSSL = shutil.which("openssl")


def self_signed(folder: Path, name: str = "coach") -> tuple[Path, Path]:
    """Return a certificate of 127.0.0.1 and its key, in PEM, that are made in a folder."""
    certificate, key = folder / f"{name}.crt", folder / f"{name}.key"
    assert OPENSSL is not None
    subprocess.run(
        [
            OPENSSL,
            "req",
            "-x509",
            "-newkey",
            "ec",
            "-pkeyopt",
            "ec_paramgen_curve:prime256v1",
            "-nodes",
            "-days",
            "2",
            "-subj",
            "/CN=127.0.0.1",
            "-addext",
            "subjectAltName=IP:127.0.0.1",
            "-keyout",
            str(key),
            "-out",
            str(certificate),
        ],
        check=True,
        capture_output=True,
        timeout=60,
    )
    return certificate, key


__all__ = ["OPENSSL", "self_signed"]
