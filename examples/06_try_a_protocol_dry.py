"""Print the steps of a run and the messages to the supply, without any instrument."""

import eimi_lab as eimi


def main() -> int:
    """Return the number of states that the run would store."""
    lines = eimi.acquire("dragon_skin_10", "type1", "bench_example", dry_run=True).lines
    print("\n".join([*lines[:5], "…", *lines[-5:]]))
    stored = sum(" stored: " in line for line in lines)
    print(f"the dry run has {len(lines)} lines; the run would store {stored} states")
    return stored


if __name__ == "__main__":
    main()
