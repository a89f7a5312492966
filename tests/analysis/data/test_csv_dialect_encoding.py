"""Encodings of tables: headers of a dozen languages, units with one high byte, and bytes that are no text."""

from __future__ import annotations

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from analysis.data.csv_dialect import encoding_of

ROWS = "".join(f"{i * 0.01:.2f};{50 - i * 0.1:.3f};{1650 + i:.2f}\r\n" for i in range(300))
HEADERS = {
    "japanese": ("時刻 (秒);圧力 (kPa);信号 (mV)", ("shift_jis", "cp932", "euc_jp", "iso2022_jp", "utf-16")),
    "korean": ("시간 (초);압력 (kPa);신호 (mV)", ("euc_kr", "cp949")),
    "chinese": ("时间 (秒);压力 (kPa);信号 (mV)", ("gb2312", "gbk", "gb18030")),
    "taiwanese": ("時間 (秒);壓力 (kPa);信號 (mV)", ("big5",)),
    "russian": ("Время (с);Давление (кПа);Сигнал (мВ)", ("cp1251", "cp866", "koi8_r")),
    "greek": ("Χρόνος (s);Πίεση (kPa);Σήμα (mV)", ("cp1253",)),
    "short": ("时间;压力", ("gb18030",)),
    "polish": ("Czas (s);Ciśnienie (kPa);Sygnał (mV);Wydłużenie", ("cp1250",)),
    "german": ("Zeit (s);Übertragungsdruck (kPa);Längenänderung (µm);T (°C)", ("cp1252", "latin-1")),
    "french": ("Temps écoulé (s);Pression relevée;Tension à 20 °C", ("cp1252",)),
    "units": ("t (s);p (kPa);x (µm);T °C;±", ("cp1252",)),
}


@pytest.mark.parametrize(
    ("header", "encoding"), [(text, name) for text, names in HEADERS.values() for name in names]
)  # fmt: skip
@pytest.mark.parametrize("newline", ["\r\n", "\n"])
def test_header_is_read_as_it_was_written(header: str, encoding: str, newline: str) -> None:
    """The names of a table in the encodings that programs of each language write."""
    content = f"{header}\r\n{ROWS}".replace("\r\n", newline).encode(encoding)
    assert content.decode(encoding_of(content)).splitlines()[0] == header


@pytest.mark.parametrize("cut", range(1, 4))
def test_a_character_that_the_end_of_the_sample_cuts_is_no_contradiction(cut: int) -> None:
    """UTF-8 whose last character is incomplete stays UTF-8, where the sample is not the whole file."""
    content = ("t,p\n1,2\n" + "€" * 9).encode()[:-cut]
    assert encoding_of(content, whole=False) == "utf-8"


@given(st.binary(max_size=400))
@example(b"\x1b$\xff")
@example(b"\xff\xfe\x00")
def test_any_bytes_have_an_encoding_that_python_knows(content: bytes) -> None:
    """Whatever the bytes: a codec that decodes them, with replacements."""
    assert isinstance(content.decode(encoding_of(content), errors="replace"), str)


@pytest.mark.parametrize("encoding", ["cp932", "gb18030", "big5", "cp949", "cp1251", "cp1250", "cp1252", "utf-16"])
def test_numbers_survive_every_encoding(encoding: str) -> None:
    """The rows below the header are the same text, whatever its language."""
    header = {"cp1251": "Время", "cp1250": "Ciśnienie", "cp1252": "µm"}.get(encoding, "時 mm")
    header = {"cp949": "압력", "gb18030": "压力"}.get(encoding, header)
    content = f"{header};p;s\n{ROWS}".encode(encoding)
    assert content.decode(encoding_of(content)).split("\n", 1)[1] == ROWS
