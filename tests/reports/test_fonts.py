"""The shipped font has every character that the program shows, and documents use no installed font."""

import io
from pathlib import Path

import pypdf
import pytest
from fontTools.fontBuilder import FontBuilder
from fontTools.pens.ttGlyphPen import TTGlyphPen
from fontTools.ttLib import TTFont

import calstation
from calstation.config.library import fonts_folder, shipped_folder

PACKAGE = Path(calstation.__file__).parent
FILES = sorted(fonts_folder().glob("*.otf"))
#: A character of Unicode that the shipped font lacks.
RARE = "\N{CJK UNIFIED IDEOGRAPH-20BB7}"


def fonts_of(pdf: bytes) -> set[str]:
    """Return the names of the fonts embedded in a PDF."""
    pages = pypdf.PdfReader(io.BytesIO(pdf)).pages
    return {font.get_object()["/BaseFont"][8:] for page in pages for font in page["/Resources"]["/Font"].values()}


def write_font(file: Path, characters: str) -> None:
    """Write a font in which each of these characters is a square."""
    pen = TTGlyphPen(None)
    for corner, draw in zip(((0, 0), (0, 700), (700, 700), (700, 0)), (pen.moveTo, *3 * [pen.lineTo]), strict=True):
        draw(corner)
    pen.closePath()
    names = [".notdef", *(f"u{ord(character):X}" for character in characters)]
    builder = FontBuilder(1000)
    builder.setupGlyphOrder(names)
    builder.setupCharacterMap({ord(character): f"u{ord(character):X}" for character in characters})
    builder.setupGlyf(dict.fromkeys(names, pen.glyph()))
    builder.setupHorizontalMetrics(dict.fromkeys(names, (800, 0)))
    builder.setupHorizontalHeader(ascent=800, descent=-200)
    builder.setupNameTable({"familyName": "Squares", "styleName": "Regular", "psName": "Squares-Regular"})
    builder.setupOS2()
    builder.setupPost()
    file.parent.mkdir(parents=True, exist_ok=True)
    builder.save(file)


def program_texts() -> dict[Path, str]:
    """Return the texts of all files that contain what the program shows."""
    folders = (PACKAGE, PACKAGE.parent / "procedures", shipped_folder())
    suffixes = {".py", ".toml", ".ts", ".typ", ".svg", ".zpl"}
    files = (file for folder in folders for file in folder.rglob("*") if file.suffix in suffixes)
    return {file: file.read_text(encoding="utf-8") for file in files}


def test_there_is_a_regular_and_a_bold_font_with_its_licence() -> None:
    assert [file.name for file in FILES] == ["CalstationSans-Bold.otf", "CalstationSans-Regular.otf"]
    assert sum(file.stat().st_size for file in FILES) < 5_000_000
    assert "SIL OPEN FONT LICENSE" in (fonts_folder() / "OFL.txt").read_text(encoding="utf-8")


@pytest.mark.parametrize("file", FILES, ids=lambda file: file.stem)
def test_font_has_every_character_of_the_program(file: Path) -> None:
    available = {chr(code) for code in TTFont(file).getBestCmap()} | {"\n", "\r", "\t"}
    missing = {path.name: sorted(set(text) - available) for path, text in program_texts().items()}
    assert {name: characters for name, characters in missing.items() if characters} == {}


@pytest.mark.parametrize("file", FILES, ids=lambda file: file.stem)
def test_font_has_gb_2312_and_names_beyond_it(file: Path) -> None:
    codes = (bytes((row, cell)) for row in range(0xA1, 0xF8) for cell in range(0xA1, 0xFF))
    characters = "".join(code.decode("gb2312", errors="ignore") for code in codes)
    assert len(characters) == 7445
    available = {chr(code) for code in TTFont(file).getBestCmap()}
    assert set(characters + "喆珺堃玥昇璟赟" + "Łódź Ångström Çelik") <= available
    assert RARE not in available


@pytest.mark.parametrize("file", FILES, ids=lambda file: file.stem)
def test_figures_and_signs_have_one_width(file: Path) -> None:
    font = TTFont(file)
    widths, names = font["hmtx"], font.getBestCmap()
    assert len({widths[names[ord(character)]][0] for character in "0123456789+−"}) == 1
    # English text needs narrow quotation marks and signs, which Chinese fonts set as wide as a Chinese character.
    assert max(widths[names[ord(character)]][0] for character in "“”‘’·×±≤≥") < 600
