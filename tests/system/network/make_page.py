#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Brings the tables of pages up to date with what nearmesh-network measured: make_page.py FOLDER PAGE...

FOLDER holds the CSV files (docs/network). In a page, what stands between "<!-- table NAME -->" and "<!-- end -->" is replaced
for the names below; other tables are left alone."""

import argparse
import csv
import pathlib
import re
import statistics


def rows_of(path):
    with open(path) as lines:
        return [{key: value if key == "kind" else float(value) for key, value in row.items()} for row in csv.DictReader(lines)]


def table(head, rows):
    return "\n".join(["| " + " | ".join(head) + " |", "|" + "---|" * len(head)] +
                     ["| " + " | ".join(str(cell) for cell in row) + " |" for row in rows]) + "\n"


def number(x, digits=3):
    return f"{x:,.0f}" if abs(x) >= 1000 else f"{x:.{digits}g}"


def flights(folder):
    return table(["Mbit/s", "lost", "certified", "contacts", "wrong", "longest without, s", "first certified, s",
                  "bytes of batches / to the peer / from it"],
                 [[f"{r['mbit_per_s']:g}", f"{100 * r['loss']:g} %", f"{r['certified']:.0f} of {r['answers']:.0f}",
                   f"{r['contacts']:.0f}", f"{r['wrong']:.0f}", f"{r['longest_lag_s']:.2f}", f"{r['first_certified_s']:.2f}",
                   " / ".join(number(r[key]) for key in ("batch_bytes", "wire_down_bytes", "wire_up_bytes"))]
                  for r in rows_of(folder / "flights.csv")])


def pipes(folder):
    before = {(r["mbit_per_s"], r["loss"]): r for r in rows_of(folder / "pipes-unpaced.csv")}
    lines = []
    for r in rows_of(folder / "pipes.csv"):
        old = before[r["mbit_per_s"], r["loss"]]
        rate = lambda x: f"{8e-6 * x['batch_bytes'] / x['seconds']:.2f}"
        sent = lambda x: f"{x['sent_bytes'] / x['sample_bytes']:.2f}"
        wait = lambda x: f"{x['overtake_median_s']:.2f} / {x['overtake_worst_s']:.2f}" if x["overtakes"] else "never"
        lines.append([f"{r['mbit_per_s']:g}", f"{100 * r['loss']:g} %", rate(r), rate(old), sent(r), sent(old), wait(r), wait(old)])
    return table(["Mbit/s", "lost", "batches, Mbit/s", "unpaced", "sent / payload", "unpaced", "needed now, s (median / worst)",
                  "unpaced"], lines)


def poses(folder):
    rows = rows_of(folder / "poses.csv")
    lines = []
    for mbit in sorted({r["mbit_per_s"] for r in rows}):
        some = [r for r in rows if r["mbit_per_s"] == mbit]
        middle = lambda key: statistics.median(r[key] for r in some)
        ratio = statistics.median(r["driven_s"] / r["simulated_s"] for r in some)
        lines.append([f"{mbit:g}", f"{middle('simulated_s'):.4f}",
                      f"{middle('driven_s'):.4f} ({max(r['driven_s'] for r in some):.4f})", f"{ratio:.2f}",
                      f"{8e-6 * middle('wire_down_bytes') / mbit:.4f}",
                      number(middle("simulated_bytes")) + " / " + number(middle("wire_down_bytes")),
                      number(middle("simulated_request_bytes")) + " / " + number(middle("wire_up_bytes")),
                      f"{middle('driven_join_s'):.2f}"])
    return table(["Mbit/s", "clock, s", "driven, s (worst)", "driven / clock", "driven bytes to the peer at that rate, s",
                  "bytes to the peer, clock / driven", "bytes from it, clock / driven", "joining, s"], lines)


def cpu_of_request(row):
    """Requests are counted from the start, so is the processor time."""
    return (row["publisher_cpu_s"] + row["publisher_start_cpu_s"]) / row["requests"]


def peers(folder):
    lines = []
    for r in rows_of(folder / "peers-light.csv") + rows_of(folder / "peers-programs.csv"):
        n, seconds = r["peers"], r["seconds"]
        lines.append([f"{n:.0f} {r['kind']}", f"{r['rate_hz']:g}", f"{r['ready_s']:.1f}",
                      f"{r['certified']:.0f} of {r['answers']:.0f}",
                      f"{1000 * r['publisher_cpu_s'] / seconds / n:.2f} / {1000 * cpu_of_request(r):.2f}",
                      number(r["batch_bytes"] / n), number(r["publisher_sent_bytes"] / seconds / n),
                      f"{(r['publisher_memory_after'] - r['publisher_memory_before']) / n / 1e3:.0f}",
                      f"{100 * r['repeated_bytes'] / r['flight_bytes']:.1f} %" if r["flight_bytes"] else "-"])
    return table(["peers", "frames/s", "all ready, s", "certified", "publisher's CPU, ms: per second and peer / per request",
                  "batches a peer, bytes", "sent a peer, bytes/s", "memory a peer, kB", "sent alike"], lines)


# Of a participant: announcements, measured on the wire at one a second, and a peer's readers and writers told to each other participant, once.
ANNOUNCED_BYTES_PER_S = 1000
ENDPOINTS, ENDPOINT_BYTES = 11, 700


def scale(folder):
    """What n peers like those of the largest light row need of one publisher, and of discovery."""
    most = max((r for r in rows_of(folder / "peers-light.csv") if r["kind"] == "light"), key=lambda r: r["peers"])
    n = most["peers"]
    # Bytes were counted in flight only: those of the share of requests that was made then.
    cpu_s = cpu_of_request(most)
    sent = most["publisher_sent_bytes"] / (most["requests"] * most["flight_bytes"] / most["batch_bytes"])
    memory = (most["publisher_memory_after"] - most["publisher_memory_before"]) / n
    lines = []
    for peers in (500, 1000, 3000, 10000):
        requests = 3.3 * peers
        lines.append([number(peers), number(requests), f"{requests * cpu_s:.1f}", number(8e-6 * requests * sent),
                      number(peers * memory / 1e6), number(8e-6 * peers * ANNOUNCED_BYTES_PER_S),
                      number(peers * peers * ENDPOINTS * ENDPOINT_BYTES / 1e9)])
    return table(["peers", "requests/s", "cores of the publisher", "publisher sends, Mbit/s", "its memory, MB",
                  "announcements heard by each, Mbit/s", "endpoints told, once, GB"], lines)


def soak(folder):
    lines = []
    for r in rows_of(folder / "soak-totals.csv"):
        ended = f"{r['landed']:.0f} / {r['left']:.0f} / {r['crashed']:.0f}"
        lines += [["peers at a time, of which stay", f"{r['peers']:.0f}, {max(1, r['peers'] // 5):.0f}"],
                  ["time, minutes", f"{r['minutes']:g}"],
                  ["lost on each peer's link, both directions", f"{100 * r['loss']:g} %"],
                  ["joined", number(r["joined"])],
                  ["of these landed / left / crashed", ended],
                  ["ended otherwise (no start, abort, hang)", f"{r['failed']:.0f}"],
                  ["answers, all checked against the full meshes", number(r["answers"])],
                  ["certified", f"{100 * r['certified'] / r['answers']:.3f} %"],
                  ["wrong", f"{r['wrong']:.0f}"],
                  ["from a program's start to its first certified answer, s: median / 95 % / worst",
                   f"{r['join_median_s']:.2f} / {r['join_p95_s']:.2f} / {r['join_worst_s']:.2f}"],
                  ["files left in /dev/shm", f"{r['shm_files'] + r['shm_files_of_others']:.0f}"]]
    return table(["", "found"], lines)


def soak_memory(folder):
    return table(["memory", "after the warm-up, MB", "at the end, MB", "slope, kB a minute"],
                 [[r["kind"], f"{r['first_kb'] / 1024:.2f}", f"{r['last_kb'] / 1024:.2f}",
                   f"{r['kb_per_minute']:+.1f} ± {r['error']:.1f}"] for r in rows_of(folder / "soak-memory.csv")])


def joins(folder):
    return table(["joins", "certified from the first frame on", "answers", "certified", "wrong", "start to first certified answer, s: median / 95 % / worst"],
                 [[f"{r['times']:.0f}", f"{r['joined']:.0f}", number(r["answers"]), number(r["certified"]), f"{r['wrong']:.0f}",
                   f"{r['median_s']:.2f} / {r['p95_s']:.2f} / {r['worst_s']:.2f}"] for r in rows_of(folder / "joins.csv")])


def outages(folder):
    lines = []
    for who in ("peer", "publisher"):
        for low, high in ((0, 2), (2, 4), (4, 10)):
            back = sorted(r["back_s"] for r in rows_of(folder / "outages.csv") if r["kind"] == who and low <= r["down_s"] < high)
            if back:
                lines.append([who, f"{low} to {high}", len(back), sum(b >= 0 for b in back),
                              f"{statistics.median(back):.2f} / {back[-1]:.2f}"])
    return table(["link of the", "down, s", "times", "served again", "after, s (median / worst)"], lines)


FAULTS = {"nobody": "nobody", "frozen": "one that takes all, then is frozen", "killed": "one that takes all, then is killed",
          "slow": "asks for everything, reads 1 kB/s", "everything": "asks for everything, again and again",
          "flood": "1,000 small requests a second", "flood-large": "1,000 requests for everything a second",
          "nowhere": "1,000 requests a second for what is not there",
          "certificates": "1,000 requests a second for certificates, from nothing, somewhere else each",
          "holder": "1,000 a second, and claims to hold all each time", "thief": "speaks for others and for the publisher",
          "inventor": "300 invented peers a second"}


def faults(folder):
    """Round 0 holds all rounds together."""
    rows = rows_of(folder / "faults.csv")
    lines = []
    for kind, text in FAULTS.items():
        some = [r for r in rows if r["kind"] == kind and r["round"] > 0]
        if not some:
            continue
        every = next(r for r in rows if r["kind"] == kind and r["round"] == 0)
        ms = lambda key: f"{1000 * every[key]:.1f}"
        change = statistics.median(r["p99_s"] / r["quiet_p99_s"] - 1 for r in some)
        middle = lambda key: statistics.median(r[key] for r in some)
        lines.append([text, f"{every['waited']:.0f}", ms("quiet_p50_s") + " / " + ms("p50_s"), ms("quiet_p99_s") + " / " + ms("p99_s"),
                      f"{100 * (every['p99_s'] / every['quiet_p99_s'] - 1):+.0f} % ({100 * change:+.0f} %)",
                      f"{every['certified']:.0f} of {every['frames']:.0f}",
                      f"{100 * middle('quiet_publisher_cpu'):.0f} % / {100 * middle('publisher_cpu'):.0f} %"])
    return table(["the bad peer", "answers waited for", "median, ms: without / with", "p99, ms", "change of p99 (median of rounds)",
                  "certified", "publisher's CPU"], lines)


def restarts(folder):
    rows = rows_of(folder / "restarts.csv")
    lines = []
    for kind, away in sorted({(r["kind"], r["away_s"]) for r in rows}):
        some = [r for r in rows if r["kind"] == kind and r["away_s"] == away]
        middle = lambda key: f"{statistics.median(r[key] for r in some):.2f}"
        back = kind == "restart"
        lines.append([f"killed, back after {away:g} s" if back else "one of two killed", len(some),
                      f"{sum(r['stuck'] for r in some):.0f}", middle("hello_s") if back else "-", middle("median_s"), middle("worst_s"),
                      f"{max(r['worst_s'] for r in some):.2f}"])
    return table(["publisher", "times", "answers that waited", "first hello, s after its start", "answers, s (median)",
                  "the last of them, s (median)", "(worst)"], lines)


def restarts_flight(folder):
    r, = rows_of(folder / "restarts-flight.csv")
    return table(["answers", "certified", "wrong", "longest without, s"],
                 [[number(r["answers"]), number(r["certified"]), f"{r['wrong']:.0f}", f"{r['longest_lag_s']:.2f}"]])


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=pathlib.Path)
    parser.add_argument("pages", type=pathlib.Path, nargs="+")
    parser.add_argument("--table", action="append", help="only this one, for each time that it is given")
    arguments = parser.parse_args()
    folder = arguments.folder
    tables = {"flights on links": flights(folder), "pipes": pipes(folder), "poses": poses(folder), "peers": peers(folder),
              "scale": scale(folder), "soak": soak(folder), "soak memory": soak_memory(folder), "joins": joins(folder),
              "outages": outages(folder), "faults": faults(folder), "restarts": restarts(folder),
              "restarts-flight": restarts_flight(folder)}
    for name in arguments.table or []:
        if name not in tables:
            parser.error(f"no table {name!r}, expected one of: {', '.join(tables)}")
    for page in arguments.pages:
        text = page.read_text()
        for name, made in tables.items():
            if arguments.table and name not in arguments.table:
                continue
            text = re.sub(rf"(<!-- table {name} -->\n).*?(<!-- end -->)", lambda m: m[1] + "\n" + made + "\n" + m[2], text,
                          flags=re.S)
        page.write_text(text)


if __name__ == "__main__":
    main()
