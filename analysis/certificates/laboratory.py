"""The laboratory that issues a certificate: a value without the libraries of the analysis, for the window."""

from __future__ import annotations

from dataclasses import dataclass

from protocol.base.errors import RequestError


@dataclass(frozen=True, slots=True)
class Laboratory:
    """The laboratory that issues a certificate."""

    name: str  # required; what else is empty is not stated
    street: str = ""
    post_code: str = ""
    city: str = ""
    country_code: str = ""  # two letters, ISO 3166-1
    email: str = ""
    phone: str = ""
    accreditation: str = ""
    procedure: str = ""
    signatory: str = ""

    def __post_init__(self) -> None:
        code = self.country_code
        if code and not (len(code) == 2 and code.isascii() and code.isalpha() and code.isupper()):
            raise RequestError(f"the laboratory's country_code is {code!r:.20}", "Give two capital letters, as in DE.")

    @property
    def address(self) -> str:
        town = " ".join(filter(None, (self.post_code, self.city)))
        return ", ".join(filter(None, (self.street, town, self.country_code)))
