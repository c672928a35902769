"""Tables of docs/performance.md: what everything costs, beside other software in the same run."""

from __future__ import annotations

from collections.abc import Callable

from _results import MISSING, Results, at_most, number, scaled, short, whole

STAGES = ("index", "observe", "choose", "advance", "strikes", "record")
SIZES = {"10k": "10,000", "100k": "100,000", "1m": "1,000,000"}
MILLIONS = scaled(1e-6, " M")


def stages(results: Results) -> list[str]:
    """Return what an avatar-frame costs by stage."""
    crowds: list[tuple[str, tuple[str, ...]]] = [("30, `boxer`, one thread", ("brawl_30", "stage_ns"))]
    crowds += [(f"{label}, `boxer_crowd`", ("scale", "spread", f"stage_ns_{size}")) for size, label in SIZES.items()]
    rows = [[label, *(results.cell(short, "control", *keys, stage) for stage in STAGES)] for label, keys in crowds]
    return results.table(["avatars [ns]", *STAGES], rows, "control")


def scale(results: Results) -> list[str]:
    """Return what an avatar-frame of control costs by layout and size."""
    layouts = {"spread": "spread out", "clustered": "clusters of a thousand", "armies": "two armies 1 km apart"}
    rows = [
        [label, *(results.cell(number, "control", "scale", layout, f"ns_per_avatar_frame_{size}") for size in SIZES)]
        for layout, label in layouts.items()
    ]
    return results.table(["control, an avatar-frame [ns]", *SIZES.values()], rows, "control")


def control(results: Results) -> list[str]:
    """Return control beside other software."""
    get = results.cell
    rows = [
        ["30 boxers, 1000 control frames [ms]", get(number, "control", "brawl_30", "milliseconds"),
         f"scipy's cKDTree alone, built and queried every frame: "
         f"{get(number, 'control', 'brawl_30', 'ckdtree_milliseconds')}; the paper: 9,000"],
        ["one decision [us]", get(scaled(1e-3), "control", "decision", "decision_nanoseconds"),
         f"motion matching, a search over the same motion: "
         f"{get(number, 'control', 'decision', 'search_microseconds_control_rate')}"],
        ["100,000 agents, one thread [agent-steps/s]", get(MILLIONS, "control", "jupedsim", "ours_per_second"),
         f"JuPedSim's collision-free speed model: "
         f"{get(MILLIONS, 'control', 'jupedsim', 'agent_steps_per_second')}"],
        ["1,000,000 boxers, a control frame, two threads [ms]", get(number, "control", "million_frame_milliseconds"),
         "real time at 15 Hz: 67"],
        ["`crowd_1m`, likewise [ms]", get(number, "control", "crowd_1m", "milliseconds"), "real time at 15 Hz: 67"],
        ["1,000,000 boxers, recording [ms]", get(number, "control", "million_record_milliseconds"), ""],
        ["the same, memory per avatar [bytes]", get(whole, "control", "million_bytes_per_avatar"), ""],
        ["collision avoidance in `brawl_30`, cost of control over that without",
         get(number, "control", "apart", "brawl_30", "ratio"), ""],
        ["the same in `armies_200`", get(number, "control", "apart", "armies_200", "ratio"), ""],
    ]  # fmt: skip
    return results.table(["", "crowdsim", "beside"], rows, "control")


def training(results: Results) -> list[str]:
    """Return training on a model of the paper's size."""
    get = results.cell
    rows = [
        ["both tables by value iteration [s]", get(number, "training", "value_iteration", "seconds_both_tables"),
         "the paper: 22,500 (6 h 15 min)"],
        ["both tables by Q-learning [s]", get(number, "training", "q_learning", "seconds_both_tables"), ""],
        ["return of Q-learning over that of value iteration",
         get(number, "training", "q_learning", "return_ratio"), ""],
        ["a Bellman sweep, one thread", get(scaled(1.0, " times as fast"), "training", "value_iteration",
         "ratio_to_quantecon_1t"), "QuantEcon's `bellman_operator`"],
        ["a Bellman sweep, two threads", get(scaled(1.0, " times as fast"), "training", "value_iteration",
         "ratio_to_quantecon_2t"), "the same"],
    ]  # fmt: skip
    return results.table(["", "crowdsim", "beside"], rows, "training")


def graph(results: Results) -> list[str]:
    """Return how long motion graphs take to build."""
    shown = (("seconds", number), ("peak_megabytes", whole), ("states", whole), ("actions", whole))
    rows = [
        [label, *(results.cell(form, "graph", "speed", row, key) for key, form in shown)]
        for row, label in (("0", "437 s, as in the paper"), ("1", "one hour"))
    ]
    header = ["motion", "time [s]", "peak memory [MB]", "states", "actions"]
    return results.table(header, rows, "graph")


def pictures(results: Results) -> list[str]:
    """Return how fast video is rendered."""
    rows = [
        [label, results.cell(number, "render", "fps", count), results.cell(number, "render", "cpu_milliseconds", count),
         beside]
        for count, label, beside in (
            ("30", "30 boxers", f"Open3D's Visualizer without shadows: "
             f"{results.cell(number, 'render', 'open3d', 'fps_30')}; the paper: 4"),
            ("1000", "1,000 boxers", ""),
            ("10000", "10,000 boxers", ""),
        )
    ]  # fmt: skip
    header = ["1280x720 to MP4", "frames per second", "CPU time of a frame [ms]", "beside, frames per second"]
    return results.table(header, rows, "render")


def waiting(results: Results) -> list[str]:
    """Return how long whole commands take that pose many avatars, in a fresh process each."""

    def row(what: str, benchmark: str, *keys: str, most: float | None = None) -> list[str]:
        shown = (
            ("wall_seconds", at_most(most)),
            ("cpu_seconds", number),
            ("peak_bytes", scaled(1e-9, "", at_most(3.0))),
        )
        return [what, *(results.cell(form, benchmark, "commands", *keys, key) for key, form in shown)]

    rows = [
        row("`brawl_30`, video of 300 frames, bodies", "render", "30", "body"),
        row("the same, capsules", "render", "30", "capsules"),
        row("`crowd_10k`, first picture", "render", "10000", "warm", most=8.0),
        row("the same, nothing compiled", "render", "10000", "cold"),
        row("`crowd_10k`, 100 pictures", "render", "10000", "many", most=40.0),
        row("`crowd_100k`, first picture", "render", "100000", "warm", most=20.0),
        row("the same, nothing compiled", "render", "100000", "cold"),
        row("30 boxers, 60,000 control frames, to BVH at 15 frames a second", "export", "warm", most=60.0),
        row("the same, nothing compiled", "export", "cold"),
        row("30 boxers, 150,000 control frames, `inspect`", "export", "inspect", most=20.0),
    ]
    return results.table(["whole command", "time [s]", "CPU time [s]", "memory [GB]"], rows, "render", "export")


def layers(results: Results) -> list[str]:
    """Return how far what pictures leave out moves bodies."""
    figures = ("said", "p99", "p99_9", "greatest")
    together = [f"all up to {size} cm" for size in (4, 6, 12)]
    parts = ["pelvis", "gaze", "second deflection", "times of separation", "times of deflection",
             "times of second deflection", "reactions of others", "deflection"]  # fmt: skip
    rows = [
        [name, *(results.cell(scaled(100.0), "layers", "layers", name, key) for key in figures)]
        for name in parts + together
    ]
    header = ["left out, of `crowd_10k` [cm]", "said of 99 of 100", "99 of 100", "999 of 1000", "greatest"]
    return results.table(header, rows, "layers")


def poses(results: Results) -> list[str]:
    """Return poses and forward kinematics beside upc-pymotion."""
    get = results.cell
    rows = [
        ["poses with blends and planted feet, one thread", get(MILLIONS, "poses", "threads_1", "poses_per_s"),
         f"upc-pymotion, forward kinematics alone: "
         f"{get(MILLIONS, 'poses', 'pymotion_forward_kinematics', 'poses_per_s')}"],
        ["the same, two threads", get(MILLIONS, "poses", "threads_2", "poses_per_s"), ""],
        ["single frames of 10,000 avatars, two threads",
         get(MILLIONS, "poses", "crowd_of_10000_by_8_frames", "poses_per_s"), ""],
        ["forward kinematics, one thread", get(MILLIONS, "kinematics", "forward_poses_per_s", "crowdsim, 1 thread"),
         f"upc-pymotion: {get(MILLIONS, 'kinematics', 'forward_poses_per_s', 'upc-pymotion fk')} (`fk`), "
         f"{get(MILLIONS, 'kinematics', 'forward_poses_per_s', 'upc-pymotion fk_quat')} (`fk_quat`)"],
        ["inverse kinematics of limbs, one thread",
         get(MILLIONS, "kinematics", "inverse_limbs_per_s", "crowdsim, 1 thread"), ""],
    ]  # fmt: skip
    return results.table(["31 joints, per second", "crowdsim", "beside"], rows, "poses", "kinematics")


def files(results: Results) -> list[str]:
    """Return reading and writing of files beside other software."""

    def bvh(way: str, *names: str) -> str:
        return ", ".join(f"{name} {results.cell(whole, 'bvh', f'{way}_mb_per_s', name)}" for name in names)

    get = results.cell
    rows = [
        ["BVH read [MB/s]", get(whole, "bvh", "read_mb_per_s", "crowdsim"),
         bvh("read", "polars", "pybvh", "bvhio", "numpy.loadtxt")],
        ["BVH written in memory [MB/s]", get(whole, "bvh", "write_mb_per_s", "crowdsim"),
         bvh("write", "polars", "numpy.savetxt")],
        ["BVH written to a file [MB/s]", get(whole, "bvh", "write_mb_per_s", "crowdsim, to a file"),
         bvh("write", "pybvh, to a file", "bvhio, to a file").replace(", to a file", "")],
        ["30 avatars, 4000 frames of poses to BVH files [s]", get(number, "export", "bvh", "crowdsim"),
         f"numpy.savetxt {get(number, 'export', 'bvh', 'numpy.savetxt')}, "
         f"orjson {get(number, 'export', 'bvh', 'orjson')}, the numbers alone"],
        ["1000 PLY clouds of 15,000 labelled points [s]", get(number, "export", "clouds", "ply"),
         f"Open3D's legacy writer, without labels: {get(number, 'export', 'clouds', 'open3d legacy')}"],
        ["the same as PCD [s]", get(number, "export", "clouds", "pcd"), ""],
    ]  # fmt: skip
    return results.table(["", "crowdsim", "beside"], rows, "bvh", "export")


def start(results: Results) -> list[str]:
    """Return what the first run and later runs of the brawl spend their time on."""
    labels = {
        "compile": "kernels compiled or loaded",
        "policies": "the boxer trained and loaded",
        "control": "control",
        "take": "the take written",
        "export": "BVH and point clouds written",
        "checksums": "checksums",
    }
    get = results.cell
    rows = [
        [label, *(get(number, "first_result", which, "stages", stage) for which in ("cold", "warm"))]
        for stage, label in labels.items()
    ]
    rows += [
        ["the whole command", get(number, "first_result", "cold", "wall_seconds"),
         get(number, "first_result", "warm", "run_seconds")],
        ["one control frame, nothing written, the whole command", "",
         get(number, "first_result", "warm", "first_frame_seconds")],
        ["`crowdsim train boxer --force`", "", get(number, "first_result", "warm", "train_boxer_seconds")],
        ["`crowdsim train boxer_crowd --force`", "", get(number, "first_result", "warm", "train_boxer_crowd_seconds")],
        ["`crowdsim train boxer_cmu --force`", "", get(number, "first_result", "warm", "train_boxer_cmu_seconds")],
        ["most memory of a process [GB]", get(scaled(1e-9), "first_result", "cold", "peak_bytes"),
         get(scaled(1e-9), "first_result", "warm", "train_peak_bytes")],
        ["beside: scipy and Open3D imported", get(number, "first_result", "reference", "import_seconds"), ""],
    ]  # fmt: skip
    header = ["`crowdsim run brawl_30` [s]", "first run", "later runs"]
    return results.table(header, rows, "first_result")


def compilation(results: Results) -> list[str]:
    """Return what kernels cost to compile, by package."""
    packages = results.get("compilation", "packages")
    rows = [] if packages is MISSING else [
        [f"`{one['package']}`" if one["package"] != "numba's own" else one["package"], str(one["kernels"]),
         str(one["compiled"]), f"{one['seconds']:.1f}"]
        for one in packages
    ]  # fmt: skip
    rows.append([
        "all",
        *(results.cell(form, "compilation", key)
          for form, key in ((whole, "kernels"), (whole, "compiled"), (number, "seconds"))),
    ])  # fmt: skip
    return results.table(["package", "kernels", "compiled", "CPU time [s]"], rows, "compilation")


def batch(results: Results) -> list[str]:
    """Return what a batch of small runs takes beside a shell loop."""
    get, figures = (
        results.cell,
        {
            "the runs [s]": (number, "seconds"),
            "start of workers [s]": (number, "start_seconds"),
            "small pictures and report [s]": (number, "after_seconds"),
            "a run by itself, median [ms]": (whole, "own_milliseconds"),
            "what the batch adds to it, of a worker's time [ms]": (whole, "overhead_milliseconds"),
        },
    )
    rows = [
        [label, *(get(show, "batch", workers, key) for workers in ("workers_1", "workers_2"))]
        for label, (show, key) in figures.items()
    ]
    rows += [
        ["time of one worker over it", "1", get(number, "batch", "speedup")],
        ["a loop over `crowdsim run`, a run [s]", get(number, "batch", "loop_seconds_per_run"), ""],
    ]
    return results.table(["100 runs of `duel`", "1 worker", "2 workers"], rows, "batch")


PERFORMANCE_TABLES: dict[str, Callable[[Results], list[str]]] = {
    "control": control,
    "stages": stages,
    "scale": scale,
    "start": start,
    "compilation": compilation,
    "training": training,
    "graph": graph,
    "pictures": pictures,
    "waiting": waiting,
    "layers": layers,
    "poses": poses,
    "files": files,
    "batch": batch,
}
