"""Draws docs/images/ratings.jpg: ratings of real materials against estimates, with photographs.

    python3 docs/images/ratings.py runs/material-ratings ../shared/data/material-ratings > ratings.html

writes a page of 1200 x 500 pixels, of which a browser takes the picture:

    chromium --headless --hide-scrollbars --window-size=1200,500 --screenshot=ratings.png ratings.html
"""

import base64
import csv
import sys
from pathlib import Path

METHOD = "stacked-2"
# The ten folds of the first rerun: each surface once.
FOLDS = {str(fold) for fold in range(10)}
ATTRIBUTES = ["surface-roughness", "shininess", "hardness", "thickness"]
# Of the surfaces in the order of their ratings.
SHOWN = [0.02, 0.5, 0.98]
WIDTH, SIDE, PHOTOGRAPH = 300, 236, 84


def estimates(run):
    """Per attribute, (rating, estimate, surface) in the order of the ratings."""
    rows = {attribute: [] for attribute in ATTRIBUTES}
    with open(run / "predictions.csv", newline="") as file:
        for row in csv.DictReader(file):
            if row["method"] == METHOD and row["rerun"] in FOLDS and row["property"] in rows:
                one = float(row["truth"]), float(row["estimate"]), row["surface"]
                rows[row["property"]].append(one)
    return {attribute: sorted(of) for attribute, of in rows.items()}


def photograph(dataset, surface):
    path = next((dataset / "frames" / surface).glob("000.*"))
    data = base64.b64encode(path.read_bytes()).decode()
    return f"data:image/{path.suffix[1:].replace('jpg', 'jpeg')};base64,{data}"


def panel(dataset, attribute, rows, left):
    values = [value for rating, estimate, _ in rows for value in (rating, estimate)]
    low, high = min(values) - 0.1, max(values) + 0.1
    at = lambda value: (value - low) / (high - low) * SIDE
    chosen = [round(share * (len(rows) - 1)) for share in SHOWN]
    parts = [f'<g transform="translate({left + 44},56)">']
    parts.append(f'<text x="{SIDE / 2}" y="-14" class="title">{attribute.replace("-", " ")}</text>')
    parts.append(f'<rect width="{SIDE}" height="{SIDE}" fill="none" stroke="#999"/>')
    parts.append(f'<line x1="0" y1="{SIDE}" x2="{SIDE}" y2="0" stroke="#bbb"/>')
    for tick in range(-3, 5):
        if low < tick < high:
            x, y = at(tick), SIDE - at(tick)
            parts.append(f'<text x="{x}" y="{SIDE + 16}" class="tick">{tick}</text>')
            parts.append(f'<text x="-10" y="{y + 4}" class="tick">{tick}</text>')
    parts.append(f'<text x="{SIDE / 2}" y="{SIDE + 36}" class="axis">rating</text>')
    parts.append(f'<text transform="translate(-26,{SIDE / 2}) rotate(-90)" class="axis">estimate</text>')
    for place, (rating, estimate, _) in enumerate(rows):
        mark = place in chosen
        parts.append(
            f'<circle cx="{at(rating)}" cy="{SIDE - at(estimate)}" r="{5 if mark else 2.6}" '
            f'fill="{"#d55e00" if mark else "#0072b2"}" fill-opacity="{1 if mark else 0.55}"/>'
        )
    for column, place in enumerate(chosen):
        rating, estimate, surface = rows[place]
        x, y = column * (PHOTOGRAPH + 4) - 12, SIDE + 56
        parts.append(
            f'<image x="{x}" y="{y}" width="{PHOTOGRAPH}" height="{PHOTOGRAPH}" '
            f'href="{photograph(dataset, surface)}"/>'
        )
        middle = x + PHOTOGRAPH / 2
        for line, text in enumerate((f"rated {rating:+z.1f}", f"est. {estimate:+z.1f}")):
            parts.append(f'<text x="{middle}" y="{y + PHOTOGRAPH + 18 + 16 * line}" class="small">{text}</text>')
    parts.append("</g>")
    return "".join(parts)


def main():
    run, dataset = map(Path, sys.argv[1:3])
    panels = [
        panel(dataset, attribute, rows, WIDTH * place)
        for place, (attribute, rows) in enumerate(estimates(run).items())
    ]
    style = (
        "body{margin:0;background:#fff} text{font-family:sans-serif;text-anchor:middle;fill:#222}"
        ".title{font-size:19px;font-weight:bold}.axis{font-size:14px}.tick{font-size:12px}.small{font-size:13px}"
    )
    source = (
        "Means of standardised ratings. Photographs and ratings: Filip et al., Material fingerprinting, "
        "Royal Society Open Science 2025."
    )
    print(
        f'<!doctype html><style>{style}</style><svg width="1200" height="500">{"".join(panels)}'
        f'<text x="600" y="492" class="small">{source}</text></svg>'
    )


main()
