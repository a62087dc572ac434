"""Writes the archives of npz/ (NumPy 2.4): python make_npz.py

Surfaces a, b, c; two locations, three repeats, properties fRS and cDF with values
100 s + 10 l + 2 r + p (s, l, r, p from 0), which every dtype holds.
"""
import os
import numpy as np

os.makedirs("npz", exist_ok=True)
s, l, r, p = np.ogrid[0:3, 0:2, 0:3, 0:2]
values = 100 * s + 10 * l + 2 * r + p
ids = ["a", "b", "c"]
keyed = lambda array: dict(zip(ids, array))

for dtype in ["<f4", "<f8", ">f8", "<i8", ">i4", "<i2", "<u2", "|u1"]:
    small = values % 200 if dtype == "|u1" else values
    np.savez_compressed(f"npz/keyed-{dtype.strip('<>|')}{'-big' * (dtype[0] == '>')}.npz", **keyed(small.astype(dtype)))
np.savez(f"npz/keyed-stored.npz", **keyed(values.astype(float)))
np.savez_compressed("npz/keyed-fortran.npz", **{i: np.asfortranarray(v.astype(float)) for i, v in keyed(values).items()})
# One location; one repeat.
np.savez_compressed("npz/keyed-repeats.npz", **keyed(values[:, 0].astype(float)))
np.savez_compressed("npz/keyed-single.npz", **keyed(values[:, 0, 0].astype(float)))
np.savez_compressed("npz/stacked.npz", values=values.astype("<f4"), names=np.array(ids))
np.savez_compressed("npz/stacked-bytes.npz", values=np.asfortranarray(values.astype(float)), names=np.array(ids, "S3"))
np.savez_compressed("npz/stacked-shuffled.npz", values=values[::-1].astype(float), names=np.array(ids[::-1]))
# What cannot be read.
np.savez_compressed("npz/pickled.npz", **keyed(values.astype(object)))
np.savez_compressed("npz/infinite.npz", **keyed(np.where(values == 101, np.inf, values)))
np.savez_compressed("npz/records.npz", **keyed(np.zeros(3, [("fRS", "f8"), ("cDF", "f8")])))
np.savez_compressed("npz/half.npz", **keyed(values.astype("f2")))
np.savez_compressed("npz/large.npz", a=np.zeros((100, 50, 2)))
