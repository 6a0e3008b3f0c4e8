"""Teach the learner `meta` and write its weights; needs the extra `train` (jax on the processor is enough).

    .venv/bin/python tools/train_meta.py --seed 1 --minutes 20 -o lab/src/printmend_lab/meta/meta.safetensors

made the weights that are shipped. The steps, not the minutes, decide the weights: ``--steps`` makes them again.
"""

import argparse
import os
import time
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("XLA_FLAGS", "--xla_cpu_multi_thread_eigen=false intra_op_parallelism_threads=1")

import numpy as np

POOL, BATCH, FRESH, DRIVES = 2000, 48, 8, 3000
RATE, LAST_RATE = 2e-3, 1e-4
FLOOR_MM = 0.003  # the answer need not be surer than this


def main() -> None:
    import jax
    from safetensors.numpy import save

    jax.config.update("jax_enable_x64", True)
    from printmend.files import replacing

    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--minutes", type=float, default=1e9)
    parser.add_argument("--steps", type=int, default=100_000)
    parser.add_argument("-o", "--output", type=Path, required=True)
    options = parser.parse_args()
    weights, steps = train(options.seed, options.steps, options.minutes * 60)
    tensors = {name: np.ascontiguousarray(value, np.float32) for name, value in weights.items()}
    with replacing(options.output, "wb") as file:
        file.write(save(tensors, {"seed": str(options.seed), "steps": str(steps)}))
    print(f"{steps} steps: {options.output}")


def train(seed: int, steps: int, seconds: float) -> tuple[dict, int]:
    """Return the weights after ``steps`` steps of Adam, or what fits into ``seconds``, and how many those were."""
    import jax
    import jax.numpy as jnp

    from printmend.printer import read_printer
    from printmend_lab.meta.bayes import FEATURES, LAYERS, OUTPUTS, WIDTH, believed, forward, membership, posterior
    from printmend_lab.meta.columns import groups
    from printmend_lab.meta.tasks import draw_drive, reach_of

    printer = read_printer("ender5")
    rng, begun = np.random.default_rng(seed), time.monotonic()
    member = membership(groups(reach_of(printer, 0)))
    drives = [draw_drive(rng, printer) for _ in range(DRIVES)]
    pool = [_lesson(rng, drives, printer, member) for _ in range(POOL)]
    print(f"{POOL} lessons in {time.monotonic() - begun:.0f} s", flush=True)
    seen = np.stack([item[0] for item in pool])
    fixed = {"mean": seen.mean(axis=0), "spread": seen.std(axis=0) + 0.05}
    sizes = [FEATURES, *[WIDTH] * (LAYERS - 1), OUTPUTS]
    free = {}
    for layer in range(LAYERS):
        scale = (0.1 if layer == LAYERS - 1 else 1.0) / np.sqrt(sizes[layer])
        free[f"w{layer}"] = rng.normal(0, scale, (sizes[layer], sizes[layer + 1]))
        free[f"b{layer}"] = np.zeros(sizes[layer + 1])

    def one(weights, features, gram, slope, asked, true):  # type: ignore[no-untyped-def]
        said = forward(jnp, {**weights, **fixed}, features)
        mean, covariance = posterior(jnp, gram, slope, believed(jnp, said[:-1], jnp.array(member)), jnp.exp(said[-1]))
        variance = jnp.einsum("ij,jk,ik->i", asked, covariance, asked) + FLOOR_MM**2
        error = (asked @ mean - true) ** 2
        return jnp.mean(jnp.log(variance) + error / variance) / 2, jnp.sqrt(jnp.mean(error))

    def loss(weights, *batch):  # type: ignore[no-untyped-def]
        nats, rms = jax.vmap(one, (None, 0, 0, 0, 0, 0))(weights, *batch)
        return jnp.mean(jnp.clip(nats, None, 20.0)), jnp.median(rms)

    step_of = jax.jit(jax.value_and_grad(loss, has_aux=True))
    first, second = ({name: np.zeros_like(value) for name, value in free.items()} for _ in range(2))
    said, number = [], 0
    for number in range(1, steps + 1):
        share = max(number / steps, (time.monotonic() - begun) / seconds)
        if share >= 1:
            break
        for place in rng.integers(POOL, size=FRESH):
            pool[place] = _lesson(rng, drives, printer, member)
        chosen = [pool[place] for place in rng.integers(POOL, size=BATCH)]
        (nats, rms), slopes = step_of(free, *(np.stack(part) for part in zip(*chosen, strict=True)))
        length = float(np.sqrt(sum(float((np.asarray(slope) ** 2).sum()) for slope in slopes.values())))
        if not np.isfinite(length):
            continue
        rate = LAST_RATE + (RATE - LAST_RATE) * 0.5 * (1 + np.cos(np.pi * min(share, 1.0)))
        for name, slope in slopes.items():
            slope = np.asarray(slope) * min(1.0, 1.0 / length)
            first[name] = 0.9 * first[name] + 0.1 * slope
            second[name] = 0.999 * second[name] + 0.001 * slope**2
            unbiased = first[name] / (1 - 0.9**number), second[name] / (1 - 0.999**number)
            free[name] = free[name] - rate * unbiased[0] / (np.sqrt(unbiased[1]) + 1e-8)
        said.append((float(nats), float(rms)))
        if number % 50 == 0:
            recent = np.mean(said[-50:], axis=0)
            print(f"{number}: {recent[0]:.3f} nats, {recent[1]:.4f} mm, {time.monotonic() - begun:.0f} s", flush=True)
    return {**fixed, **free}, number


def _lesson(rng: np.random.Generator, drives: list, printer: object, member: np.ndarray) -> tuple:
    from printmend_lab.meta.bayes import first_look
    from printmend_lab.meta.tasks import draw_lesson

    drawn = draw_lesson(rng, drives[rng.integers(len(drives))], printer)  # type: ignore[arg-type]
    found = drawn.evidence
    features = first_look(np, found.gram, found.slope, np.float64(found.square), np.float64(found.count),
                          np.float64(found.seen), member)  # fmt: skip
    return features, found.gram, found.slope, drawn.asked, drawn.true_mm


if __name__ == "__main__":
    main()
