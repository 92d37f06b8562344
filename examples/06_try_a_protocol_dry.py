"""What a run would do, down to the messages to the supply, with nothing connected."""

from eimi_lab.acquisition.dry_run import dry_run
from eimi_lab.config.protocol import load_protocol
from eimi_lab.config.rig import load_rig
from eimi_lab.config.specimen import load_specimen


def main() -> int:
    """How many states the run would store."""
    lines: list[str] = []
    dry_run(load_protocol("dragon_skin_10"), load_specimen("type1"), load_rig("bench_example"), lines.append)
    print("\n".join([*lines[:5], "…", *lines[-5:]]))
    stored = sum(" stored: " in line for line in lines)
    print(f"{len(lines)} lines, {stored} states stored")
    return stored


if __name__ == "__main__":
    main()
