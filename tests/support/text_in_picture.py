"""Where a text stands in a picture of the viewer's window, so that tests find controls as people do."""

import numpy as np
from PIL import Image, ImageDraw, ImageFont

# As palpate-view draws it at scale 1: 15 pixels from ascent to descent, the letters at fractions of
# a pixel and without kerning. Drawn larger and made smaller again.
_FINER = 8
_FONT = ImageFont.truetype("/usr/share/fonts/truetype/dejavu/DejaVuSans.ttf", 103)
# What another text of the same length reaches is less.
ALIKE = 0.9


def _drawn(text):
    width = sum(_FONT.getlength(letter) for letter in text)
    image = Image.new("L", ((int(width) // _FINER + 3) * _FINER, 20 * _FINER), 0)
    x = 0.0
    for letter in text:
        ImageDraw.Draw(image).text((x, 15 * _FINER), letter, font=_FONT, fill=255, anchor="ls")
        x += _FONT.getlength(letter)
    image = image.resize((image.width // _FINER, 20), Image.BOX)
    return np.asarray(image.crop(image.getbbox())).astype(float)


def _likeness(picture, sought):
    """Normalised cross-correlation, at each place of the sought picture's upper left corner."""
    height, width = sought.shape
    sought = sought - sought.mean()
    whole = np.fft.rfft2(picture)

    def sums(spectrum, kernel):
        padded = np.zeros_like(picture)
        padded[:height, :width] = kernel
        return np.fft.irfft2(spectrum * np.conj(np.fft.rfft2(padded)), s=picture.shape)

    ones = np.ones_like(sought)
    deviation = sums(np.fft.rfft2(picture ** 2), ones) - sums(whole, ones) ** 2 / sought.size
    # Flat ground is like nothing.
    likeness = np.abs(sums(whole, sought)) / np.sqrt(
        np.maximum(deviation, 1000.0) * (sought ** 2).sum())
    likeness[picture.shape[0] - height:] = likeness[:, picture.shape[1] - width:] = 0.0
    return likeness


def likeness_of(text, picture):
    """How much the likest part of a picture is like a text, to tell which of several similar texts
    it shows."""
    return float(_likeness(np.asarray(picture.convert("L")).astype(float), _drawn(text)).max())


def places_of(text, picture):
    """The middles (x, y) of the text's occurrences, the most alike first; bright on dark or dark
    on bright."""
    sought = _drawn(text)
    height, width = sought.shape
    likeness = _likeness(np.asarray(picture.convert("L")).astype(float), sought)
    places = []
    while likeness.max() >= ALIKE:
        y, x = np.unravel_index(likeness.argmax(), likeness.shape)
        places.append((int(x) + width // 2, int(y) + height // 2))
        likeness[max(0, y - height):y + height, max(0, x - width // 2):x + width // 2 + 1] = 0.0
    return places
