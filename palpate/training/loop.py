"""Training from start to end: it resumes where it was interrupted, and keeps the best model by validation.

Lightning's `CSVLogger` is not used, because it begins a new file when a training resumes, and `ModelCheckpoint` is not,
because it moves files from the temporary folder: across file systems that is no atomic write.
"""

import csv
import hashlib
import json
import logging
import shutil
import sys
import time
import warnings
from pathlib import Path
from typing import Any

import lightning.pytorch as lightning
import torch
from lightning.pytorch.callbacks import EarlyStopping
from tqdm import tqdm

from palpate import checksums
from palpate.atomic import atomic_write
from palpate.inference import checkpoints
from palpate.inference.machine import Machine
from palpate.training.learners import Diverged, Learner

log = logging.getLogger(__name__)

HISTORY = ("step", "seconds", "train_loss", "validation_loss", "rate")
# Between lines of progress in a log: seconds, and a share of the time so far. Few lines, however long it takes.
LOG_EVERY, LOG_SHARE = 10.0, 0.02
BEST, LAST = "best.ckpt", "last.ckpt"
PRECISIONS = ("32-true", "64-true", "bf16-mixed", "16-mixed")


class Recorder(lightning.Callback):
    """Keeps the history, writes the best and the last checkpoint, and logs progress.

    folder: where the checkpoints are during the training. name: of the model in its run, which they state.
    """

    def __init__(self, folder: Path, label: str, name: str | None = None):
        self.folder, self.label, self.name = folder, label, name
        self.history: list[dict[str, float]] = []
        self.seconds = 0.0  # of training before this process
        self.finished = False

    @property
    def best(self) -> dict[str, float]:
        """The row of the history with the lowest validation loss."""
        return min(self.history, key=lambda row: row["validation_loss"])

    def state_dict(self) -> dict[str, Any]:
        return {"history": self.history, "seconds": self._now(), "finished": self.finished}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        self.history, self.seconds, self.finished = list(state["history"]), state["seconds"], state["finished"]

    def _now(self) -> float:
        return self.seconds + time.perf_counter() - self.start

    def on_fit_start(self, trainer, learner) -> None:
        self.start = self.logged = time.perf_counter()

    def on_train_start(self, trainer, learner) -> None:
        self.began_at = trainer.global_step
        first, hidden = trainer.global_step, not sys.stderr.isatty()
        self.bar = tqdm(total=learner.steps, initial=first, desc=self.label, unit="step", disable=hidden)

    def on_train_epoch_start(self, trainer, learner) -> None:
        self.losses: list[torch.Tensor] = []

    def on_train_batch_end(self, trainer, learner, outputs, batch, batch_idx) -> None:
        self.losses.append(outputs["loss"].detach())
        self.bar.update()
        now = time.perf_counter()
        if now - self.logged >= max(LOG_EVERY, LOG_SHARE * (now - self.start)):
            self._log_progress(trainer, learner)

    def _log_progress(self, trainer, learner) -> None:
        self.logged = time.perf_counter()
        done = trainer.global_step
        rate = (done - self.began_at) / (self.logged - self.start)
        loss, best = float(torch.stack(self.losses).mean()), ""
        if self.history:
            best = f", best validation {self.best['validation_loss']:.3f} at step {self.best['step']}"
        log.info("%s: step %d of %d, %.2f a second, loss %.3f%s", self.label, done, learner.steps, rate, loss, best)

    def on_validation_end(self, trainer, learner) -> None:
        row = {
            "step": trainer.global_step,
            "seconds": round(self._now(), 2),
            "train_loss": float(torch.stack(self.losses).double().mean()),
            "validation_loss": float(trainer.callback_metrics["validation_loss"]),
            "rate": trainer.optimizers[0].param_groups[0]["lr"],
        }
        self.history.append(row)
        if self.best is row and trainer.is_global_zero:
            reached = {"name": self.name, "step": row["step"], "validation_loss": row["validation_loss"]}
            checkpoints.save(self.folder / BEST, learner.kind, learner.eval_model, learner.stated() | reached)
        self.bar.set_postfix_str(f"validation {row['validation_loss']:.3f}, best {self.best['validation_loss']:.3f}")

    def on_train_epoch_end(self, trainer, learner) -> None:
        if trainer.should_stop:
            patience, step = learner.settings.patience, trainer.global_step
            log.info("%s: no better for %d evaluations: stopped at step %d", self.label, patience, step)
        self.finished = trainer.should_stop or trainer.global_step >= learner.steps
        # All processes take part. A state is complete at the end of a round only.
        partial = self.folder / f".partial-{LAST}"
        trainer.save_checkpoint(partial)
        if trainer.is_global_zero:
            partial.replace(self.folder / LAST)

    def on_train_end(self, trainer, learner) -> None:
        self._log_progress(trainer, learner)
        self.bar.close()


def train(
    learner: Learner, folder: Path | str, checkpoint_folder: Path | str, machine: Machine, label: str
) -> dict[str, Any]:
    """Train a model, or resume an interrupted training of the same model; the result is the same.

    learner: the model with its data and settings. folder: gets `best.ckpt` (see `checkpoints`), `training.json` (which
    is returned), and `history.csv` (step, seconds, train_loss, validation_loss, rate: a row an evaluation, losses in
    the tables' unit). checkpoint_folder: checkpoints of the training in progress; removed at the end. Those of another
    config or other data are ignored. label: for progress.

    Raises Diverged, naming the sample and the last good checkpoint, if the prediction, the loss or its gradient becomes
    NaN or infinite, before any weight is changed by it; ValueError for a precision below float32.
    """
    folder, checkpoints_folder = Path(folder), Path(checkpoint_folder)
    if machine.precision not in PRECISIONS:
        raise ValueError(f"precision {machine.precision!r}: choose one of {', '.join(PRECISIONS)}")
    _silence_lightning()
    torch.set_num_threads(machine.threads)
    accelerator = machine.accelerator()
    identity = _identity(learner, machine)
    recorder = Recorder(checkpoints_folder, label, checkpoints.name_of(folder / BEST))
    callbacks = [recorder]
    if patience := learner.settings.patience:
        callbacks.append(EarlyStopping("validation_loss", patience=patience, check_on_train_epoch_end=False))
    trainer = lightning.Trainer(
        accelerator=accelerator,
        devices=machine.devices if accelerator == "gpu" else 1,
        precision=machine.precision,
        max_epochs=-(-learner.steps // learner.validation_interval),
        gradient_clip_val=learner.settings.clip,
        callbacks=callbacks,
        num_sanity_val_steps=0,
        reload_dataloaders_every_n_epochs=1,
        logger=False,
        enable_checkpointing=False,
        enable_progress_bar=False,
        enable_model_summary=False,
        use_distributed_sampler=False,
        default_root_dir=checkpoints_folder,
    )
    resume = _resumable(checkpoints_folder, identity)
    if resume:
        log.info("%s: continues from %s", label, resume)
        recorder.load_state_dict(torch.load(resume, weights_only=False)["callbacks"][recorder.state_key])
    # Adam's averages of a weight without gradient fall below 1e-38 in some 800 steps; processors compute with such
    # numbers many times slower than with 0.
    torch.set_flush_denormal(True)
    try:
        if not recorder.finished:
            trainer.fit(learner, ckpt_path=resume)
    except Diverged as error:
        best = f"; the best model so far is {checkpoints_folder / BEST}" if (checkpoints_folder / BEST).exists() else ""
        raise Diverged(
            f"{label}: {error}{best}. Lower the rate or clip the gradient (config training.override), "
            "or take precision 32-true, and train again"
        ) from None
    finally:
        torch.set_flush_denormal(False)
    summary = {**_summary(learner, recorder, machine, accelerator), "identity": identity}
    if trainer.is_global_zero:
        _write(folder, checkpoints_folder, recorder.history, summary)
    return summary


def _silence_lightning() -> None:
    """Silences Lightning's banner and its DataLoader and logging warnings (no DataLoader is used)."""
    for name in ("lightning.pytorch", "lightning.fabric", "lightning.pytorch.utilities.rank_zero"):
        logging.getLogger(name).setLevel(logging.ERROR)
    for text in ("does not have many workers", "IterableDataset", "tensorboardX", "LeafSpec", "litlogger", "sync_dist"):
        warnings.filterwarnings("ignore", message=f".*{text}")


def _identity(learner: Learner, machine: Machine) -> str:
    """Digest of all that determines the weights."""
    determines = {"precision": machine.precision, "schema": checkpoints.SCHEMA_VERSION, **learner.stated()}
    return hashlib.sha256(json.dumps(determines, sort_keys=True).encode()).hexdigest()


def _resumable(checkpoints_folder: Path, identity: str) -> Path | None:
    """The last checkpoint of an interrupted training with this identity; checkpoints of another are removed.

    Raises CheckpointError or DamagedFile if it is damaged: training anew is the user's choice.
    """
    marker, last = checkpoints_folder / "identity", checkpoints_folder / LAST
    remedy = f"remove {checkpoints_folder} to train from the start"
    if last.exists() and marker.exists() and checksums.read_text(marker, remedy).strip() == identity:
        checkpoints.require_intact(last)
        return last
    if checkpoints_folder.exists():
        reason = "is of another config or other data, or stopped before its first evaluation"
        log.info("%s %s: begins anew", checkpoints_folder, reason)
        shutil.rmtree(checkpoints_folder)
    checkpoints_folder.mkdir(parents=True)
    with atomic_write(marker, checksum=True) as partial:
        partial.write_text(identity + "\n")
    return None


def _summary(learner: Learner, recorder: Recorder, machine: Machine, accelerator: str) -> dict[str, Any]:
    name = torch.cuda.get_device_name() if accelerator == "gpu" else "cpu"
    return {
        **learner.stated(),
        "parameters": sum(weights.numel() for weights in learner.model.parameters()),
        "validated": len(learner.validation_samples),
        "steps": recorder.history[-1]["step"],
        "best_step": recorder.best["step"],
        "validation_loss": recorder.best["validation_loss"],
        "seconds": recorder.history[-1]["seconds"],
        "machine": {**machine._asdict(), "found": name, "torch": torch.__version__},
    }


def _write(folder: Path, checkpoints_folder: Path, history: list[dict[str, float]], summary: dict[str, Any]) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    with atomic_write(folder / "history.csv", checksum=True) as partial, open(partial, "w", newline="") as file:
        writer = csv.DictWriter(file, HISTORY)
        writer.writeheader()
        writer.writerows(history)
    with atomic_write(folder / "training.json", checksum=True) as partial:
        partial.write_text(json.dumps(summary, indent=2, sort_keys=True) + "\n")
    checkpoints.require_intact(checkpoints_folder / BEST)
    with atomic_write(folder / BEST, checksum=True) as partial:
        shutil.copyfile(checkpoints_folder / BEST, partial)
    shutil.rmtree(checkpoints_folder)
