"""The symbols of elid's texts in plain ASCII, for terminals and pipes that know nothing else."""

from __future__ import annotations

SYMBOLS = {
    "·": "*", "×": "x", "±": "+-", "−": "-", "–": "-", "—": "-", "…": "...", "→": "->", "←": "<-",
    "²": "^2", "³": "^3", "°": " deg", "≤": "<=", "≥": ">=", "≈": "~", "≠": "!=", "∞": "inf", "√": "sqrt",
    "µ": "u", "μ": "u", "σ": "sigma", "τ": "tau", "θ": "theta", "ω": "omega", "π": "pi", "Δ": "delta",
    "α": "alpha", "β": "beta", "δ": "delta", "φ": "phi", "Υ": "Jm", "∫": "integral", "∂": "d", "ẋ": "dx",
    "“": '"', "”": '"', "‘": "'", "’": "'", "\N{NO-BREAK SPACE}": " ", "█": "#", "▁": "_", "•": "*",
    "₀": "0", "₁": "1", "₂": "2", "₃": "3", "ᵀ": "^T", "\u0307": "", "\u0308": "",
}  # fmt: skip


def to_ascii(text: str) -> str:
    r"""Return the text in ASCII: known symbols spelt out, anything else as an escape such as ``\xe4``."""
    if text.isascii():
        return text
    return "".join(SYMBOLS.get(c, c) for c in text).encode("ascii", "backslashreplace").decode("ascii")
