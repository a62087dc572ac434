"""Writes the files of png/ and jpeg/ (Pillow 13.0, pypng 0.20220715, NumPy 2.4): python make_images.py

Pictures are 16 wide and 12 high. Samples follow a formula that the tests repeat:
R = 16 x, G = 20 y, B = (x + y) * 9, alpha = 17 x, grey = 16 x + y; at 16 bits each is 257 times that plus
x + y, 65535 at most.
"""
import numpy as np, png
from PIL import Image, ImageOps

W, H = 16, 12
x, y = np.meshgrid(np.arange(W), np.arange(H))
r, g, b, a, grey = 16 * x, 20 * y, (x + y) * 9, 17 * x, 16 * x + y


def wide(c):
    return np.minimum(257 * c + x + y, 65535)


def save_png(name, planes, bits, interlace=False, **mode):
    rows = np.stack(planes, -1).reshape(H, -1).tolist()
    png.Writer(W, H, bitdepth=bits, interlace=interlace, **mode).write(open(f"png/{name}.png", "wb"), rows)


save_png("grey8", [grey], 8, greyscale=True)
save_png("grey16", [wide(grey)], 16, greyscale=True)
save_png("grey-alpha8", [grey, a], 8, greyscale=True, alpha=True)
save_png("grey-alpha16", [wide(grey), wide(a)], 16, greyscale=True, alpha=True)
save_png("rgb8", [r, g, b], 8, greyscale=False)
save_png("rgb8-interlaced", [r, g, b], 8, interlace=True, greyscale=False)
save_png("rgb16", [wide(r), wide(g), wide(b)], 16, greyscale=False)
save_png("rgba8", [r, g, b, a], 8, greyscale=False, alpha=True)
save_png("rgba16", [wide(r), wide(g), wide(b), wide(a)], 16, greyscale=False, alpha=True)
# The colour of palette entry i is (16 i, 255 - 16 i, 7 i), its alpha 17 i; pixels have entry x.
palette = [(16 * i, 255 - 16 * i, 7 * i) for i in range(16)]
save_png("palette4", [x], 4, palette=palette)
save_png("palette4-alpha", [x], 4, palette=[(*c, 17 * i) for i, c in enumerate(palette)])
for bits in (1, 2, 4):
    save_png(f"grey{bits}", [x % 2**bits], bits, greyscale=True)
# Grey 8 with level 32 declared transparent.
png.Writer(W, H, bitdepth=8, greyscale=True, transparent=32).write(
    open("png/grey8-transparent.png", "wb"), (16 * x).tolist())

rgb = Image.fromarray(np.stack([r, g, b], -1).astype(np.uint8))
# Stored turned so that Pillow shows each of them upright, as rgb.
turns = {2: "FLIP_LEFT_RIGHT", 3: "ROTATE_180", 4: "FLIP_TOP_BOTTOM", 5: "TRANSPOSE",
         6: "ROTATE_90", 7: "TRANSVERSE", 8: "ROTATE_270"}
for turn in range(1, 9):
    exif = Image.Exif()
    exif[0x0112] = turn
    stored = rgb.transpose(Image.Transpose[turns[turn]]) if turn > 1 else rgb
    stored.save(f"jpeg/turned{turn}.jpg", quality=98, subsampling=0, exif=exif)
    if turn == 6:
        stored.save("png/turned6.png", exif=exif)
        assert ImageOps.exif_transpose(Image.open("png/turned6.png")).tobytes() == rgb.tobytes()
    shown = np.asarray(ImageOps.exif_transpose(Image.open(f"jpeg/turned{turn}.jpg")), int)
    assert abs(shown - np.asarray(rgb, int)).max() < 4
rgb.save("jpeg/rgb.jpg", quality=98, subsampling=0)
rgb.save("jpeg/subsampled.jpg", quality=98, subsampling=2)
rgb.save("jpeg/progressive.jpg", quality=98, subsampling=0, progressive=True)
rgb.save("jpeg/restarts.jpg", quality=98, subsampling=0, restart_marker_blocks=1)
Image.fromarray(grey.astype(np.uint8)).save("jpeg/grey.jpg", quality=98)

# CMYK: cyan, magenta, yellow, black = R, G, B, 9 y. Pillow marks it as Adobe's and inverts it.
ink = Image.fromarray(np.stack([r, g, b, 9 * y], -1).astype(np.uint8), "CMYK")
ink.save("jpeg/cmyk-adobe.jpg", quality=98, subsampling=0)
# A camera's stray bytes before a marker.
data = open("jpeg/rgb.jpg", "rb").read()
at = data.index(b"\xff\xdb")
open("jpeg/stray-bytes.jpg", "wb").write(data[:at] + b"\x00" * 9 + data[at:])

# A larger picture with detail, for ../../benches.
y, x = np.mgrid[0:256, 0:256] / 256
noise = np.random.default_rng(1).normal(size=(256, 256, 1))
weave = 0.5 + 0.2 * np.sin(120 * x) * np.sin(110 * y)
large = 255 * np.clip(np.dstack([weave, 0.8 * weave, 0.6 * weave + 0.2 * x]) + 0.03 * noise, 0, 1)
Image.fromarray(large.astype(np.uint8)).save("../../benches/photo.jpg", quality=90)
