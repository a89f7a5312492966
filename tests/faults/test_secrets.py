"""No key, token or password among the tracked files; works without a network."""

from __future__ import annotations

import math
import re
import shutil
import subprocess
from collections import Counter
from pathlib import Path

import pytest

from tests.faults.drill import ROOT

KNOWN = {
    "private key": r"-----BEGIN (?:[A-Z]+ )*PRIVATE KEY-----",
    "AWS key": r"\b(?:AKIA|ASIA)[0-9A-Z]{16}\b",
    "GitHub token": r"\b(?:gh[pousr]_[A-Za-z0-9]{36}|github_pat_[A-Za-z0-9_]{40,})",
    "GitLab token": r"\bglpat-[A-Za-z0-9_-]{20}",
    "Slack token": r"\bxox[baprs]-[A-Za-z0-9-]{10,}",
    "Google key": r"\bAIza[0-9A-Za-z_-]{35}",
    "PyPI token": r"\bpypi-AgEI[A-Za-z0-9_-]{50,}",
    "provider key": r"\bsk-[A-Za-z0-9_-]{20,}",
    "JSON web token": r"\beyJ[A-Za-z0-9_-]{10,}\.eyJ[A-Za-z0-9_-]{10,}\.",
    "address with a password": r"\b[a-z]{3,10}://[^\s/:@\"'{}<>]{1,60}:[^\s/:@\"'{}<>]{3,60}@",
    "password": r"(?i)\b(?:password|passwd|secret|api_?key|auth_?token)\b\s*[:=]\s*[\"'][^\"'\s]{6,}[\"']",
}
WORD = re.compile(r"[A-Za-z0-9+/_=-]{32,}")
HEX = re.compile(r"[0-9a-f]+|[0-9A-F]+")
BITS_PER_CHARACTER = 4.6  # of text in base64; identifiers and paths stay below, hexadecimal cannot reach it
DATA = {".json", ".svg", ".csv", ".lock"}  # vectors, drawings and hashes: long runs of digits and paths


def suspicious(text: str, *, entropy: bool = True) -> list[str]:
    """Return what looks like a secret in a text."""
    found = [name for name, pattern in KNOWN.items() if re.search(pattern, text)]
    words = {word for word in WORD.findall(text) if re.search(r"[0-9]", word)} if entropy else set()
    return found + [
        f"random text {word[:12]}..."
        for word in sorted(words)
        if not HEX.fullmatch(word) and bits_per_character(word) > BITS_PER_CHARACTER
    ]


def bits_per_character(word: str) -> float:
    """Return the Shannon entropy of a word's characters, bits per character."""
    n = len(word)
    return -sum(k / n * math.log2(k / n) for k in Counter(word).values())


def tracked() -> list[Path]:
    """Return the tracked files of the repository."""
    if shutil.which("git") is None:
        pytest.skip("git is not installed")
    done = subprocess.run(["git", "ls-files", "-z"], capture_output=True, cwd=ROOT)
    if done.returncode:
        pytest.skip("not a git checkout")
    return [ROOT / name for name in done.stdout.decode().split("\0") if name]


def test_no_secret_is_tracked() -> None:
    """No known kind of key, no password in an address or assignment, no random text in sources."""
    found = {}
    for path in tracked():
        try:
            text = path.read_text(encoding="utf-8")
        except (UnicodeDecodeError, FileNotFoundError):
            continue
        secrets = suspicious(text, entropy=path.suffix not in DATA) if path != Path(__file__).resolve() else []
        if secrets:
            found[str(path.relative_to(ROOT))] = secrets
    assert found == {}


@pytest.mark.parametrize(
    "text",
    [
        "-----BEGIN " + "RSA PRIVATE KEY-----",
        "AKIA" + "IOSFODNN7EXAMPLE",
        "ghp_" + "a1B2" * 9,
        "postgres://lab:" + "hunter22@db/x",
        'password = "' + 'correct-horse"',
        "key = 9f" + "Qz7Lw2RtYv8KpXc4NmBj6HgDs1FaEu3ToIi5+/Wx",
    ],
)
def test_each_kind_of_secret_is_found(text: str) -> None:
    """Each kind, invented here."""
    assert suspicious(text)


@pytest.mark.parametrize(
    "text",
    ["tests/faults/test_what_is_no_picture_of_the_grid", "0" * 64, "2144df1c" * 8, "a" * 80, "https://a.example/b"],
)
def test_plain_text_is_not_a_secret(text: str) -> None:
    """Long names, checksums and addresses are no secrets."""
    assert suspicious(text) == []
