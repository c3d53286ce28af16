"""The share of the processors that the host gave to others: what judges times prints it."""

import contextlib


def _ticks():
    """All, and the stolen ones: user, nice, system, idle, iowait, irq, softirq, steal."""
    with open("/proc/stat", encoding="ascii") as file:
        fields = [int(field) for field in file.readline().split()[1:9]]
    return sum(fields), fields[7]


@contextlib.contextmanager
def stolen_share():
    """Prints the share at the end of the block."""
    all_before, stolen_before = _ticks()
    try:
        yield
    finally:
        all_now, stolen_now = _ticks()
        share = (stolen_now - stolen_before) / max(1, all_now - all_before)
        print(f"the host took {100 * share:.1f} % of the processors", flush=True)
