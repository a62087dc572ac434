import os
import pickle
import subprocess
import threading
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

import sps
from conftest import ROOT
from files import read_safetensors, write_png, write_safetensors
from golden import squeezenet, uniform

FRAMES = ROOT / "fixtures/tiny-dataset/frames"


def image(height, width, seed=0):
    return np.random.default_rng(seed).integers(0, 256, (height, width, 3), dtype=np.uint8)


def same_bits(one, other):
    return one.shape == other.shape and one.tobytes() == other.tobytes()


def test_it_gives_what_pytorch_gives(tmp_path):
    weights = tmp_path / "squeezenet.safetensors"
    write_safetensors(weights, squeezenet())
    encoder = sps.Encoder("squeezenet1-0", weights, depths="last")
    # The network's own normalisation, undone.
    mean, std = np.array([0.485, 0.456, 0.406]), np.array([0.229, 0.224, 0.225])
    images = uniform("golden/squeeze", (2, 3, 224, 224)).transpose(0, 2, 3, 1) * std + mean
    expected = read_safetensors(ROOT / "fixtures/golden/squeezenet1_0.safetensors")["embedding"]
    found = encoder.transform(images.astype(np.float32))
    assert found.dtype == np.float32
    np.testing.assert_allclose(found, expected, atol=2e-6 * np.abs(expected).max())


def test_what_it_is(encoder):
    assert (encoder.name, encoder.width, encoder.precision) == ("efficientnet-lite-body", 784, "f32")
    expected = 'Encoder("efficientnet-lite-body", "built-in", precision="f32", depths="all")'
    assert repr(encoder) == expected
    widths = [16, 24, 40, 80, 112, 192, 320]
    assert encoder.blocks == [(f"stage-{i}", width) for i, width in enumerate(widths, 1)]
    embeddings = encoder.transform([image(20, 30)])
    assert (embeddings.dtype, embeddings.shape) == (np.float32, (1, 784))


def test_it_tells_surfaces_apart(encoder):
    frames = sorted(FRAMES.glob("*/002.*"))
    embeddings = encoder.transform(frames)
    assert embeddings.shape == (len(frames), 784)
    assert np.linalg.matrix_rank(embeddings) == len(frames)


def test_depths(encoder):
    deep = sps.Encoder("efficientnet-lite-body", "built-in", depths="last")
    assert deep.blocks == [("stage-7", 320)]
    some = sps.Encoder("efficientnet-lite-body", "built-in", depths=["stage-2", "stage-7"])
    photograph = image(40, 50)
    whole, part, last = (one.transform(photograph) for one in [encoder, some, deep])
    assert same_bits(part, np.concatenate([whole[:, 16:40], whole[:, 464:]], axis=1))
    assert same_bits(last, np.ascontiguousarray(whole[:, 464:]))
    again = pickle.loads(pickle.dumps(some))
    assert (repr(again), again.blocks) == (repr(some), some.blocks)
    for wrong in ["first", ["stage-9"], []]:
        with pytest.raises(ValueError, match="depths"):
            sps.Encoder("efficientnet-lite-body", "built-in", depths=wrong)
    for wrong in [None, 3, [3]]:
        with pytest.raises(TypeError, match="depths"):
            sps.Encoder("efficientnet-lite-body", "built-in", depths=wrong)


def test_a_file_and_its_pixels_have_the_same_embedding(encoder, tmp_path):
    pixels, path = image(33, 47), tmp_path / "image.png"
    write_png(path, pixels)
    from_file = encoder.transform([path])
    assert same_bits(encoder.transform([pixels]), from_file)
    assert same_bits(encoder.transform(str(path)), from_file)
    shares = pixels.astype(np.float32) / np.float32(255)
    assert same_bits(encoder.transform(shares), from_file)


def test_a_row_does_not_depend_on_the_others(encoder):
    images = [image(*size) for size in [(40, 40), (40, 40), (17, 60), (40, 40), (1, 1)]] * 5
    alone = np.concatenate([encoder.transform(one) for one in images])
    assert same_bits(encoder.transform(images), alone)
    assert same_bits(encoder.transform(one for one in images), alone)
    mixed = [FRAMES / "denim-01/000.png", image(8, 8), str(FRAMES / "denim-02/000.jpg")]
    assert same_bits(encoder.transform(mixed)[1:2], encoder.transform(image(8, 8)))


def test_any_layout_in_memory(encoder):
    pixels = image(30, 20)
    expected = encoder.transform(pixels)
    assert same_bits(encoder.transform(np.asfortranarray(pixels)), expected)
    assert same_bits(encoder.transform(np.repeat(pixels, 2, axis=1)[:, ::2]), expected)
    backwards = np.ascontiguousarray(pixels[::-1, ::-1])[::-1, ::-1]
    assert same_bits(encoder.transform(backwards), expected)
    read_only = pixels.copy()
    read_only.flags.writeable = False
    assert same_bits(encoder.transform(np.stack([read_only, read_only])), np.repeat(expected, 2, 0))


class OfPil:
    """What numpy knows of an image of PIL."""

    def __init__(self, pixels):
        self.__array_interface__ = pixels.__array_interface__
        self.pixels = pixels


class OfTorch:
    """What numpy knows of a tensor of torch."""

    def __init__(self, pixels):
        self.pixels = pixels

    def __dlpack__(self, **settings):
        return self.pixels.__dlpack__(**settings)

    def __dlpack_device__(self):
        return self.pixels.__dlpack_device__()

    def __iter__(self):
        return map(OfTorch, self.pixels)


def test_images_of_others(encoder):
    images = np.stack([image(20, 30, seed) for seed in range(2)])
    expected = encoder.transform(images)
    first = np.ascontiguousarray(images.transpose(0, 3, 1, 2))
    for one in (OfPil(images[0]), OfTorch(images[0]), OfTorch(first[0])):
        assert same_bits(encoder.transform(one), expected[:1])
        assert same_bits(encoder.transform([one, images[1]]), expected)
    assert same_bits(encoder.transform(OfTorch(first)), expected)
    with pytest.raises(ValueError, match=r"the image is of shape \[20, 30\], expected"):
        encoder.transform(OfPil(images[0, ..., 0].copy()))


def test_images_of_pil(encoder):
    pil = pytest.importorskip("PIL.Image")
    pixels = image(20, 30)
    assert same_bits(encoder.transform(pil.fromarray(pixels)), encoder.transform(pixels))


def test_encoders_are_listed():
    built_in = {one["name"]: one["depths"] for one in sps.list_encoders() if one["built_in"]}
    assert built_in == {"efficientnet-lite-body": [f"stage-{i}" for i in range(1, 8)]}
    assert "i3d" not in {one["name"] for one in sps.list_encoders()}


def test_no_images(encoder):
    assert encoder.transform([]).shape == (0, 784)


@pytest.mark.parametrize(
    ("images", "error", "message"),
    [
        (image(4, 4)[..., 0], ValueError, r"the image is of shape \[4, 4\], expected \(height"),
        ([image(4, 4), np.zeros((4, 4, 4), np.uint8)], ValueError, r"image 1 is of shape \[4, 4"),
        ([image(4, 4).astype(float)], TypeError, "image 0 is of dtype float64, expected uint8, or"),
        (np.full((2, 2, 3), 255, np.float32), ValueError, "the image holds 255, expected values"),
        (np.full((2, 2, 3), np.nan, np.float32), ValueError, "the image holds NaN"),
        ([np.zeros((0, 4, 3), np.uint8)], ValueError, "image 0 has 0 x 4 pixels, expected sides"),
        ([None], TypeError, "image 0 is a NoneType, expected an array or a path"),
        (7, TypeError, "'int' object is not iterable"),
        ("none.png", FileNotFoundError, "none.png: cannot be read"),
        ([Path(__file__)], ValueError, "test_encoder.py: begins with"),
    ],
)
def test_what_is_no_image(encoder, images, error, message):
    with pytest.raises(error, match=message):
        encoder.transform(images)


def test_what_is_no_encoder(tmp_path):
    with pytest.raises(ValueError, match='unknown encoder "alexnet", expected one of'):
        sps.Encoder("alexnet", "built-in")
    with pytest.raises(ValueError, match="squeezenet1-0 has no built-in weights, only efficientnet-lite-body has"):
        sps.Encoder("squeezenet1-0", "built-in")
    with pytest.raises(ValueError, match="precision: found f16, expected f32, bf16"):
        sps.Encoder("efficientnet-lite-body", "built-in", precision="f16")
    with pytest.raises(FileNotFoundError, match="none.safetensors: cannot be read"):
        sps.Encoder("efficientnet-lite-body", tmp_path / "none.safetensors")
    write_safetensors(tmp_path / "other.safetensors", {"x": np.zeros(1)})
    with pytest.raises(ValueError, match="other.safetensors: tensor .* is missing"):
        sps.Encoder("efficientnet-lite-body", tmp_path / "other.safetensors")


def test_bf16_is_near(encoder):
    exact = encoder.transform(image(64, 64))
    near = sps.Encoder("efficientnet-lite-body", "built-in", precision="bf16").transform(image(64, 64))
    assert 0 < np.linalg.norm(near - exact) < 0.02 * np.linalg.norm(exact)


def test_int8_is_near_once_it_is_calibrated(encoder, tmp_path):
    images = [image(48, 40, seed) for seed in range(4)] + [image(64, 64)]
    with pytest.raises(ValueError, match="int8"):
        sps.Encoder("efficientnet-lite-body", "built-in", precision="int8")
    file = tmp_path / "int8.safetensors"
    calibrated = encoder.calibrated(images, file)
    assert (calibrated.name, calibrated.precision) == ("efficientnet-lite-body", "int8")
    exact, near = encoder.transform(images), calibrated.transform(images)
    assert 0 < np.linalg.norm(near - exact) < 0.1 * np.linalg.norm(exact)
    again = sps.Encoder("efficientnet-lite-body", file, precision="int8")
    for copy in (again, pickle.loads(pickle.dumps(calibrated))):
        assert same_bits(copy.transform(images), near)


def test_what_cannot_be_calibrated(encoder, tmp_path):
    with pytest.raises(ValueError, match="image"):
        encoder.calibrated([], tmp_path / "int8.safetensors")
    (tmp_path / "file").write_bytes(b"")
    with pytest.raises(OSError, match="int8.safetensors: cannot be written"):
        encoder.calibrated(image(64, 64), tmp_path / "file" / "int8.safetensors")
    assert [path.name for path in tmp_path.iterdir()] == ["file"]
    assert encoder.precision == "f32"


def test_a_copy_of_another_process(encoder):
    copy = pickle.loads(pickle.dumps(encoder))
    assert same_bits(copy.transform(image(9, 9)), encoder.transform(image(9, 9)))


def test_eight_threads_at_once(encoder):
    images = [image(48, 48, seed) for seed in range(8)]
    alone = [encoder.transform(one) for one in images]
    at_once = threading.Barrier(8)

    def embed(one):
        at_once.wait()
        return [encoder.transform(one) for _ in range(5)]

    with ThreadPoolExecutor(8) as threads:
        for expected, found in zip(alone, threads.map(embed, images)):
            assert all(same_bits(expected, one) for one in found)


def test_other_threads_go_on_meanwhile(encoder):
    turns, embedded = 0, threading.Event()

    def embed():
        before = turns
        encoder.transform(np.zeros((16, 224, 224, 3), np.uint8))
        during.append(turns - before)
        embedded.set()

    during = []
    thread = threading.Thread(target=embed)
    thread.start()
    while not embedded.is_set():
        turns += 1
    thread.join()
    # None where the interpreter is held.
    assert during[0] > 1000


@pytest.mark.skipif("XTASK" not in os.environ, reason="XTASK names no binary of the command line")
def test_the_command_line_gives_the_same_bits(encoder, tmp_path):
    images = sorted(FRAMES.glob("*/000.*"))
    out = tmp_path / "embeddings.safetensors"
    command = [os.environ["XTASK"], "embed", "--encoder", encoder.name, "--weights", "built-in"]
    subprocess.run([*command, "--out", out, *images], check=True)
    assert same_bits(encoder.transform(images), read_safetensors(out)["embeddings"])
