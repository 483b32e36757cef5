"""Make the font in `data/fonts` for `make fonts` from three Debian packages, which `apt-get` downloads.

Chinese, Latin and Greek letters come from Noto Sans CJK SC. In that font many symbols, such as ± and ×, and quotation
marks are as wide as a Chinese character; these, and characters that it lacks, come from Noto Sans, Noto Sans Math and
Noto Sans Symbols 2. The result is called Calstation Sans, so that no installed font is used in its place.
"""

import bz2
import hashlib
import subprocess
import sys
import tempfile
from itertools import count
from pathlib import Path

from fontTools import subset
from fontTools.pens.t2CharStringPen import T2CharStringPen
from fontTools.pens.transformPen import TransformPen
from fontTools.ttLib import TTCollection, TTFont

FAMILY = "Calstation Sans"
FOLDER = Path(__file__).parents[1] / "data" / "fonts"

#: Debian packages: name, version, SHA-256 of the file.
PACKAGES = (
    (
        "fonts-noto-cjk",
        "1:20220127+repack1-1",
        "4a2515eb6db3978b897fef9709ed0d2b1f4c6c4df4d83d6c4ef65f71f1b1f502",
    ),
    ("fonts-noto-core", "20201225-1", "58f4f0bb6720f919f92096b3508e1412a0f1544424ade6c5b5bf1eb694dd64ba"),
    ("unicode-data", "15.0.0-1", "5efef23bbb1c6a133ecbdd63a2cfa07159ccacf5466a49e2426101c5ecd691fc"),
)

#: Latin, Greek, punctuation, superscripts and subscripts, letter-like signs, arrows, mathematics, shapes, check marks.
RANGES = (
    (0x20, 0x17F),
    (0x300, 0x30C),
    (0x370, 0x3FF),
    (0x1D40, 0x1D6A),
    (0x1E00, 0x1EFF),
    (0x2010, 0x2044),
    (0x2070, 0x209C),
    (0x20AC, 0x20AC),
    (0x2100, 0x214F),
    (0x2190, 0x21FF),
    (0x2200, 0x22FF),
    (0x232B, 0x232B),
    (0x25A0, 0x25FF),
    (0x26A0, 0x26A0),
    (0x2713, 0x271A),
)

#: Superscripts and subscripts, which must all come from one font.
RAISED = {0xB2, 0xB3, 0xB9, *range(0x2070, 0x209D)}

#: Last symbol that needs a narrow form, and width of a Chinese character in units of the font.
LAST_SYMBOL, EM = 0x22FF, 1000

#: Distance of lines, in units of the font: 1.2 times the size instead of 1.45, which spreads rows of a table too far.
ASCENT, DESCENT = 950, -250


def download(folder: Path) -> None:
    """Download and unpack the packages in a folder. Raises SystemExit if one has other content."""
    for name, version, digest in PACKAGES:
        subprocess.run(["apt-get", "download", f"{name}={version}"], cwd=folder, check=True)
        (package,) = folder.glob(f"{name}_*.deb")
        if hashlib.sha256(package.read_bytes()).hexdigest() != digest:
            sys.exit(f"{package.name} is not the package from which the font was made")
        subprocess.run(["dpkg-deb", "-x", package, folder], check=True)


def hanzi(folder: Path) -> set[int]:
    """Return the characters of GB 2312 and of China's list of 8105 standard characters, which has more for names."""
    codes = (bytes((row, cell)) for row in range(0xA1, 0xF8) for cell in range(0xA1, 0xFF))
    characters = {ord(text) for code in codes if (text := code.decode("gb2312", errors="ignore"))}
    with bz2.open(folder / "usr/share/unicode/Unihan_OtherMappings.txt.bz2", "rt", encoding="utf-8") as lines:
        characters |= {int(line.split()[0][2:], 16) for line in lines if "\tkTGH\t" in line}
    return characters


def make(folder: Path, weight: str) -> TTFont:
    """Return the font of a weight, Regular or Bold."""
    noto = folder / "usr/share/fonts/truetype/noto"
    collection = TTCollection(folder / f"usr/share/fonts/opentype/noto/NotoSansCJK-{weight}.ttc")
    (font,) = (each for each in collection.fonts if each["name"].getDebugName(1) == "Noto Sans CJK SC")
    font.recalcTimestamp = False
    available, widths = font.getBestCmap(), font["hmtx"]
    names = (f"NotoSans-{weight}", "NotoSansMath-Regular", "NotoSansSymbols2-Regular")
    others = [TTFont(noto / f"{name}.ttf") for name in names]
    wanted = hanzi(folder) | {code for first, last in RANGES for code in range(first, last + 1)}
    added = {}
    for code in wanted:
        wide = code in available and code <= LAST_SYMBOL and widths[available[code]][0] >= EM
        if code not in available or code in RAISED or wide:
            fonts = [other for other in others if code in other.getBestCmap()]
            added.update({code: fonts[0]} if fonts else {})

    options = subset.Options(layout_features=["kern", "ccmp", "mark"], notdef_outline=True, name_IDs=["*"])
    options.drop_tables += ["vhea", "vmtx", "VORG", "BASE"]
    subsetter = subset.Subsetter(options)
    subsetter.populate(unicodes=wanted - set(added))
    subsetter.subset(font)
    for code, other in sorted(added.items()):
        add_glyph(font, code, other)
    set_names(font, weight)
    font["hhea"].ascent = font["OS/2"].sTypoAscender = font["OS/2"].usWinAscent = ASCENT
    font["hhea"].descent = font["OS/2"].sTypoDescender = DESCENT
    font["OS/2"].usWinDescent = -DESCENT
    font["hhea"].lineGap = font["OS/2"].sTypoLineGap = 0
    return font


def add_glyph(font: TTFont, code: int, other: TTFont) -> None:
    """Add the character of another font to the character-keyed CFF table of the font."""
    source = other.getBestCmap()[code]
    scale = font["head"].unitsPerEm / other["head"].unitsPerEm
    width, bearing = (round(scale * value) for value in other["hmtx"][source])
    top = font["CFF "].cff.topDictIndex[0]
    private = top.FDArray[fd := top.FDSelect[font.getGlyphID(font.getBestCmap()[ord("A")])]].Private
    glyphs, strings = other.getGlyphSet(), top.CharStrings
    name = next(free for number in count(1) if (free := f"cid{number:05d}") not in strings.charStrings)
    pen = T2CharStringPen(width, glyphs)
    glyphs[source].draw(TransformPen(pen, (scale, 0, 0, scale, 0, 0)))
    strings.charStrings[name] = len(strings.charStringsIndex)
    strings.charStringsIndex.append(pen.getCharString(private, top.GlobalSubrs))
    top.FDSelect.append(fd)
    top.charset.append(name)
    font.setGlyphOrder(top.charset)
    font["hmtx"][name] = (width, bearing)
    for table in font["cmap"].tables:
        if table.isUnicode() and (table.format == 12 or code <= 0xFFFF):
            table.cmap[code] = name


def set_names(font: TTFont, weight: str) -> None:
    """Give the font its name, and state the origin of its glyphs."""
    postscript = f"{FAMILY.replace(' ', '')}-{weight}"
    names = font["name"]
    names.names = [each for each in names.names if each.nameID in (5, 13, 14) and each.langID == 0x409]
    texts = {
        0: "Copyright 2014-2021 Adobe (http://www.adobe.com/). Copyright 2015-2020 Google LLC.",
        1: FAMILY,
        2: weight,
        3: postscript,
        4: f"{FAMILY} {weight}",
        6: postscript,
        10: "Subset of Noto Sans CJK SC with symbols of Noto Sans, Noto Sans Math and Noto Sans Symbols 2.",
    }
    for number, text in texts.items():
        names.setName(text, number, 3, 1, 0x409)
    names.names.sort()
    cff = font["CFF "].cff
    cff.fontNames = [postscript]
    cff.topDictIndex[0].FullName, cff.topDictIndex[0].FamilyName = texts[4], FAMILY


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as temporary:
        download(Path(temporary))
        for weight in ("Regular", "Bold"):
            file = FOLDER / f"CalstationSans-{weight}.otf"
            make(Path(temporary), weight).save(file)
            print(file.name, file.stat().st_size, hashlib.sha256(file.read_bytes()).hexdigest())
