"""Training from start to end: it resumes where it was interrupted, and keeps the last model where its
rate falls to 0, the best by validation where it stays."""

import hashlib
import json
import logging
import math
import shutil
import time
from pathlib import Path
from typing import Any, cast

import torch
from lightning_fabric import Fabric

from palpate import seal
from palpate.atomic import atomic_write
from palpate.batch import progress
from palpate.learning import checkpoints
from palpate.learning.learners import Diverged, Learner
from palpate.learning.machine import Machine
from palpate.text_files import read_text, write_rows

log = logging.getLogger(__name__)

HISTORY = ("step", "seconds", "train_loss", "validation_loss", "rate")
# Between lines of progress in a log: seconds, and a share of the time so far. Few lines, however long it takes.
LOG_EVERY, LOG_SHARE = 10.0, 0.02
BEST, LAST = "best.ckpt", "last.ckpt"
# Of the weights without a gradient. A layer of ReLUs that is 0 for every input keeps the gradient from all before it:
# 99.9994 % of the weights of such a network, 1 to 11 % of others (docs/evidence/trials.md).
MOST_IDLE = 0.99
PRECISIONS = ("32-true", "bf16-mixed")
Row = dict[str, Any]  # of `HISTORY`


class Training:
    """A training in progress: its history, its steps, and its checkpoints.
    folder: of the checkpoints. label: for progress. name: of the model in its run, which the kept one states."""

    def __init__(self, learner: Learner, fabric: Fabric, folder: Path, label: str, name: str | None = None):
        self.learner, self.fabric, self.folder, self.label, self.name = learner, fabric, folder, label, name
        optimiser, self.schedule = learner.optimiser(fabric.device)
        self.module, self.optimiser = fabric.setup(learner, optimiser)
        learner.begin(fabric.global_rank, fabric.world_size)
        self.history: list[Row] = []

    @property
    def state(self) -> dict[str, Any]:  # what a training goes on from
        parts = {"model": self.learner.model, "optimiser": self.optimiser, "schedule": self.schedule}
        return {**parts, "history": self.history}

    @property
    def best(self) -> Row:
        return min(self.history, key=lambda row: row["validation_loss"])

    @property
    def kept(self) -> Row:
        """The evaluation whose model is kept. By a rate that falls to 0 the last step is what the others lead to; a few
        validation objects choose worse (docs/evidence/trials.md)."""
        return self.best if self.learner.settings.schedule == "constant" else self.history[-1]

    @property
    def done(self) -> int:  # steps that were made and evaluated
        return self.history[-1]["step"] if self.history else 0

    @property
    def out_of_patience(self) -> bool:  # whether the last evaluations were no better
        patience = self.learner.settings.patience
        return bool(self.history and patience and self.history.index(self.best) + patience < len(self.history))

    def run(self) -> None:
        """All steps that are left, each evaluation with a row of the history and a checkpoint."""
        learner, began_at, start = self.learner, self.done, time.perf_counter()
        logged, before = start, self.history[-1]["seconds"] if self.history else 0.0
        bar = progress(total=learner.steps, initial=began_at, desc=self.label, unit="step")
        while self.done < learner.steps and not self.out_of_patience:
            losses = []
            for step in range(self.done, min(self.done + learner.validation_interval, learner.steps)):
                losses.append(self._step(step))
                bar.update()
                now = time.perf_counter()
                if now - logged >= max(LOG_EVERY, LOG_SHARE * (now - start)) or step + 1 == learner.steps:
                    logged, reached = now, f"step {step + 1} of {learner.steps}"
                    rate, loss, kept = (step + 1 - began_at) / (now - start), float(torch.stack(losses).mean()), ""
                    if self.history:
                        kept = f", validation {self.kept['validation_loss']:.3f} at step {self.kept['step']}"
                    log.info("%s: %s, %.2f a second, loss %.3f%s", self.label, reached, rate, loss, kept)
            gradients = [weights.grad for weights in learner.model.parameters() if weights.grad is not None]
            idle = sum(int((each == 0).sum()) for each in gradients) / sum(each.numel() for each in gradients)
            if idle > MOST_IDLE:
                raise Diverged(
                    f"by step {step + 1} the network is dead: {idle:.4%} of its weights get no gradient, and its "
                    "prediction no longer depends on its input"
                )
            row = {
                "step": step + 1,
                "train_loss": float(torch.stack(losses).double().mean()),
                "validation_loss": self._validation_loss(),
                "rate": self.schedule.get_last_lr()[0],
                "seconds": round(before + time.perf_counter() - start, 2),
            }
            self.history.append(row)
            self._save()
            bar.set_postfix_str(f"validation {row['validation_loss']:.3f}, best {self.best['validation_loss']:.3f}")
        bar.close()
        if self.out_of_patience:
            patience = learner.settings.patience
            log.info("%s: no better for %d evaluations: stopped at step %d", self.label, patience, self.done)

    def _step(self, step: int) -> torch.Tensor:
        """Make a step; returns its loss."""
        self.module.train()
        self.optimiser.zero_grad()
        loss = self.module(step)
        self.fabric.backward(loss)
        clip = self.learner.settings.clip or math.inf
        norm = self.fabric.clip_gradients(self.module, self.optimiser, max_norm=clip, error_if_nonfinite=False)
        if norm is None or not math.isfinite(norm):  # One such gradient would turn every weight into NaN.
            raise Diverged(f"the gradient is NaN or infinite in {self.learner.step_name()}")
        self.optimiser.step()
        self.schedule.step()
        return loss.detach()

    @torch.inference_mode()
    def _validation_loss(self) -> float:
        """The mean loss of the validation samples of all processes, by what they choose."""
        self.module.eval()
        with self.fabric.autocast():
            losses = self.learner.validation_losses()
        count = losses.new_tensor(float(len(losses)))
        total, count = (cast(torch.Tensor, self.fabric.all_reduce(n, reduce_op="sum")) for n in (losses.sum(0), count))
        return float(self.learner.choose(total / count))

    def _save(self) -> None:
        """Write the state, and the model if it is the one to keep so far."""
        row, partial = self.history[-1], self.folder / f".partial-{LAST}"
        if self.kept is row and self.fabric.is_global_zero:
            reached = {"name": self.name, "step": row["step"], "validation_loss": row["validation_loss"]}
            stated = self.learner.stated() | reached
            checkpoints.save(self.folder / BEST, self.learner.kind, self.learner.model, stated)
        self.fabric.save(partial, self.state)
        if self.fabric.is_global_zero:
            seal.write(partial, name=LAST)
            partial.replace(self.folder / LAST)


def train(
    learner: Learner,
    folder: Path | str,
    checkpoint_folder: Path | str,
    machine: Machine,
    label: str,
    made_from: seal.MadeFrom = seal.NOTHING,
) -> dict[str, Any]:
    """Train a model, or resume an interrupted training of the same model; the result is the same.
    folder: gets `best.ckpt` (see `checkpoints`), `training.json` (which is returned), and `history.csv` (a row an
    evaluation, losses in the tables' unit), with seals that state `made_from`. checkpoint_folder: of the training in
    progress; removed at the end; those of another config or other data are ignored. label: for progress. Raises
    Diverged, naming the sample and the last good checkpoint, before any weight is lost."""
    folder, checkpoints_folder = Path(folder), Path(checkpoint_folder)
    if machine.precision not in PRECISIONS:
        raise ValueError(f"precision {machine.precision!r}: choose one of {', '.join(PRECISIONS)}")
    torch.set_num_threads(machine.threads)
    accelerator = machine.torch_device().type
    devices = machine.devices if accelerator == "cuda" else 1
    precision = cast(Any, machine.precision)  # a text among those above; Fabric's type lists all as literals
    fabric = Fabric(accelerator=accelerator, devices=devices, precision=precision)
    determines = {"precision": machine.precision, "schema": checkpoints.SCHEMA_VERSION, **learner.stated()}
    identity = hashlib.sha256(json.dumps(determines, sort_keys=True).encode()).hexdigest()
    if fabric.local_rank == 0:  # the first process starts the others
        _prepare(checkpoints_folder, identity)
    fabric.launch()
    training = Training(learner, fabric, checkpoints_folder, label, checkpoints.name_of(folder / BEST))
    if (last := checkpoints_folder / LAST).exists():
        log.info("%s: continues from %s", label, last)
        state = training.state
        fabric.load(last, state, weights_only=True)
        training.history = state["history"]
    # Adam's averages of a weight without gradient fall below 1e-38 in some 800 steps; processors compute with such
    # numbers many times slower than with 0.
    torch.set_flush_denormal(True)
    try:
        training.run()
    except Diverged as error:
        kept = f"; the model so far is {checkpoints_folder / BEST}" if (checkpoints_folder / BEST).exists() else ""
        raise Diverged(
            f"{label}: {error}{kept}. Lower the rate or clip the gradient (config training.override), "
            "or take precision 32-true, and train again"
        ) from None
    finally:
        torch.set_flush_denormal(False)
    name = torch.cuda.get_device_name() if accelerator == "cuda" else "cpu"
    summary = {
        **learner.stated(),
        "parameters": sum(weights.numel() for weights in learner.model.parameters()),
        "validated": sum(map(len, learner.validation_batches)),
        "steps": training.done,
        "best_step": training.kept["step"],
        "validation_loss": training.kept["validation_loss"],
        "seconds": training.history[-1]["seconds"],
        "machine": {**machine._asdict(), "found": name, "torch": torch.__version__},
        "identity": identity,
    }
    if fabric.is_global_zero:
        _write(folder, checkpoints_folder, training.history, summary, made_from)
    return summary


def _prepare(checkpoints_folder: Path, identity: str) -> None:
    """Make the folder of checkpoints. Those of an interrupted training with this identity stay, of another are removed.
    Raises CheckpointError or DamagedFile if it is damaged: training anew is the user's choice."""
    marker, last = checkpoints_folder / "identity", checkpoints_folder / LAST
    if last.exists() and marker.exists() and read_text(marker).strip() == identity:
        checkpoints.require_intact(last)
        return
    if checkpoints_folder.exists():
        reason = "is of another config or other data, or stopped before its first evaluation"
        log.info("%s %s: begins anew", checkpoints_folder, reason)
        shutil.rmtree(checkpoints_folder)
    with atomic_write(marker, seal.NOTHING) as partial:
        partial.write_text(identity + "\n")


def _write(
    folder: Path, checkpoints_folder: Path, history: list[Row], summary: dict[str, Any], made_from: seal.MadeFrom
) -> None:
    write_rows(folder / "history.csv", HISTORY, ([row[name] for name in HISTORY] for row in history), made_from)
    with atomic_write(folder / "training.json", made_from) as partial:
        partial.write_text(json.dumps(summary, indent=2, sort_keys=True) + "\n")
    checkpoints.require_intact(checkpoints_folder / BEST)
    with atomic_write(folder / BEST, made_from) as partial:
        shutil.copyfile(checkpoints_folder / BEST, partial)
    shutil.rmtree(checkpoints_folder)
