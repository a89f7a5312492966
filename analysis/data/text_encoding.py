"""The encoding of a text file of numbers, from its first bytes.

A byte-order mark, NUL bytes and valid UTF-8 decide for themselves. Else it is cp1252, the usual Windows code page, in
which a unit such as µm or °C is a single high byte, unless the bytes contradict it: then charset-normalizer ranks the
encodings in common use, and one that spells time, pressure or signal wins. Numbers read alike in every one of these; a
wrong guess garbles names only.
"""

from __future__ import annotations

import codecs
import re

_MARKS = ((b"\xef\xbb\xbf", "utf-8-sig"), (b"\xff\xfe", "utf-16"), (b"\xfe\xff", "utf-16"))
_SAMPLE = 200  # bytes in which NULs are counted
_MOST = 64_000  # bytes of lines with other than ASCII that are compared with the habits of languages
_RUN = re.compile(rb"[\x80-\xff]{2}")  # hardly ever in western text, in nearly every word of the others
_WORDS = (
    "时间", "压力", "信号", "電圧", "時間", "時刻", "圧力", "壓力", "訊號", "信號", "시간", "압력", "신호",
    "время", "давление", "сигнал", "χρόνος", "πίεση", "σήμα", "זמן", "לחץ", "אות", "الوقت", "الزمن", "الضغط", "الإشارة",
)  # fmt: skip
_ESCAPE = b"\x1b$"  # shifts ISO 2022 to Japanese
_WESTERN = "cp1252"
_CENTRAL_EUROPEAN = ["cp1250", "cp1257", "cp1254"]
_OTHERS = ["cp932", "euc_jp", "cp949", "gb18030", "big5", "cp1251", "koi8_r", "cp866", "cp1253", "cp1255", "cp1256"]


def encoding_of(head: bytes, *, whole: bool = True) -> str:
    """Return the name of the encoding by the first bytes; the last character may be cut if they are not the `whole`."""
    for mark, name in _MARKS:
        if head.startswith(mark):
            return name
    if head[:_SAMPLE].count(0) > len(head[:_SAMPLE]) // 4:  # every other byte of plain text in UTF-16
        return "utf-16-be" if head[:1] == b"\0" else "utf-16-le"
    if _ESCAPE in head:
        return "iso2022_jp"
    try:
        codecs.getincrementaldecoder("utf-8")().decode(head, final=whole)
    except UnicodeDecodeError:
        return _of_bytes(b"\n".join(line for line in head.splitlines() if not line.isascii())[:_MOST])
    return "utf-8"


def _of_bytes(lines: bytes) -> str:
    """Return the encoding of lines that are no UTF-8."""
    if _RUN.search(lines):
        return _likeliest(lines, _OTHERS)
    if _is_western(lines):
        return _WESTERN
    return _likeliest(lines, _CENTRAL_EUROPEAN)


def _is_western(lines: bytes) -> bool:
    """Whether every high byte is a character of cp1252, and none a symbol between the letters of a word."""
    try:
        text = lines.decode(_WESTERN)
    except UnicodeDecodeError:
        return False
    return not any(
        not now.isascii() and not now.isalpha() and before.isalpha() and after.isalpha()
        for before, now, after in zip(text, text[1:], text[2:], strict=False)
    )


def _likeliest(lines: bytes, among: list[str]) -> str:
    from charset_normalizer import from_bytes  # only such a file needs it

    ranked = list(from_bytes(lines, cp_isolation=among, threshold=0.5))
    best = max(ranked, key=lambda match: sum(word in str(match).lower() for word in _WORDS), default=None)
    return best.encoding if best is not None else _WESTERN
