"""Draws the tables of results.json that ask for it: plot_results.py RESULTS OUT_FOLDER. Needs matplotlib."""
import json
import os
import sys

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt


def draw(table, file):
    plot = table["plot"]
    names = [column["name"] for column in table["columns"]]
    x_idx = names.index(plot["x"])
    rows = [row for row in table["rows"] if row[x_idx] is not None]
    fig, ax = plt.subplots(figsize=(6.4, 3.6), constrained_layout=True)
    for k, name in enumerate(plot["y"]):
        y_idx = names.index(name)
        values = [row[y_idx] if isinstance(row[y_idx], (int, float)) else float("nan") for row in rows]
        if plot["kind"] == "lines":
            ax.plot([row[x_idx] for row in rows], values, marker="o", label=name)
        else:
            width = 0.8 / len(plot["y"])
            ax.bar([i + (k - (len(plot["y"]) - 1) / 2) * width for i in range(len(rows))], values, width, label=name)
    if plot["kind"] == "bars":
        labels = [f"{row[x_idx]:g}" if isinstance(row[x_idx], (int, float)) else str(row[x_idx]) for row in rows]
        ax.set_xticks(range(len(rows)), labels)
    ax.set_xlabel(plot["x"])
    ax.set_ylabel(plot["y_label"])
    ax.set_ylim(bottom=0)
    ax.set_title(table["title"], fontsize=10)
    ax.legend(fontsize=8)
    fig.savefig(file, dpi=120, metadata={"Software": None})
    plt.close(fig)


def main():
    with open(sys.argv[1], encoding="utf-8") as stream:
        results = json.load(stream)
    for experiment in results["experiments"]:
        for table in experiment["tables"]:
            if "plot" in table and table["rows"]:
                draw(table, os.path.join(sys.argv[2], table["id"] + ".png"))


if __name__ == "__main__":
    main()
