"""Which grasp next: errors after each of some grasps that a strategy chooses one by one among those stored. It scores
each by those chosen so far (docs/evaluation.md). What stored grasps touch is known to the oracle only."""

from collections.abc import Callable, Iterator, Sequence
from functools import partial

import numpy as np
import pandas as pd
import torch
from scipy.spatial.distance import cdist

from palpate.batch import generator
from palpate.charts import build_tree
from palpate.experiments import Correction
from palpate.learning.data import ExperimentData
from palpate.learning.evaluate import BATCH_SIZE, POINTS, Trained, points_on, predict, row_of
from palpate.learning.metrics import score
from palpate.learning.rows import SELECTION_COLUMNS, EvaluationError
from palpate.learning.samples import Assembler, Sample, in_batches
from palpate.models.kriging import Kriging

MOST = 5  # grasps that are chosen

Chosen = tuple[int, ...]
Scores = Callable[[Chosen], np.ndarray]  # of the grasps chosen so far -> (g,), of every grasp
Errors = Callable[[Sequence[Chosen]], Sequence[float]]


def choose(scores: Scores, first: Chosen, count: int) -> Iterator[Chosen]:
    """`first`, then with one more grasp each time, up to `count`: the first of those left that score most."""
    chosen = first
    yield chosen
    while len(chosen) < count:
        left = scores(chosen).astype(float)
        left[list(chosen)] = -np.inf
        chosen = (*chosen, int(np.argmax(left)))
        yield chosen


def farthest(sites: np.ndarray, chosen: Chosen) -> np.ndarray:
    """Scores of grasps by their sites (g, s, 3), m: the mean distance to the nearest site of those chosen."""
    away = cdist(sites.reshape(-1, 3), sites[list(chosen)].reshape(-1, 3)).min(axis=1, initial=np.inf)
    return away.reshape(len(sites), -1).mean(axis=1)


def most_uncertain(sites: np.ndarray, correction: Correction, chosen: Chosen) -> np.ndarray:
    """Scores of grasps by their sites (g, s, 3), m: the correction's mean variance there, given those of the chosen."""
    places = torch.from_numpy(sites).double()
    known = places[list(chosen)].reshape(-1, 3)
    variance = Kriging(known, torch.zeros(len(known), 1), correction).variance(places.reshape(-1, 3))
    return variance.reshape(len(sites), -1).mean(dim=1).numpy()


def least_error(errors: Errors, grasps: int, chosen: Chosen) -> np.ndarray:
    """Scores of grasps by the error that each leaves beside those chosen."""
    left = [grasp for grasp in range(grasps) if grasp not in chosen]
    better = np.full(grasps, -np.inf)
    better[left] = -np.asarray(errors([(*chosen, grasp) for grasp in left]))
    return better


def evaluate_selection(
    trained: Trained, data: ExperimentData, splits: Sequence[str], points: int = POINTS
) -> pd.DataFrame:
    """Errors after 0 to 5 grasps of each strategy, for each object of some splits: `rows.SELECTION_COLUMNS`. Only with
    an unoccluded image they begin with none. Raises EvaluationError for a model, or a run, of one grasp."""
    experiment, rows = trained.experiment, []
    count = min(MOST, experiment.grasps, data.grasps) if experiment.touch else 0
    if count < 2:
        raise EvaluationError(f"{experiment.name}: grasps are chosen for models, and in runs, of two and more")
    assemble, first = Assembler(data, experiment, trained.device), () if experiment.vision == "unoccluded" else (0,)
    for number in data.of_split(*splits):
        order = generator(trained.seed, data.objects[number], "selection").permutation(data.grasps)
        sites = data["charts"][number].mean(axis=2)[order]
        errors = _errors_of(trained, data, assemble, number, order, points)
        strategies: dict[str, Scores] = {
            "random": lambda chosen: -np.arange(data.grasps),
            "farthest": partial(farthest, sites),
        }
        if experiment.correction:
            strategies["uncertainty"] = partial(most_uncertain, sites, experiment.correction)
        for strategy, scores in (strategies | {"oracle": partial(least_error, errors, data.grasps)}).items():
            for chosen in choose(scores, first, count):
                row = {"strategy": strategy, "grasps": len(chosen), "stored": data.grasps}
                rows.append(row_of(trained, data, Sample(number)) | row | {"chamfer": errors([chosen])[0]})
    return pd.DataFrame(rows, columns=SELECTION_COLUMNS)


def _errors_of(
    trained: Trained, data: ExperimentData, assemble: Assembler, number: int, order: np.ndarray, points: int
) -> Errors:
    """Chamfer distances (m^2 x 9000) of an object's predictions from choices of as many grasps, each measured once."""
    tree, known = build_tree(torch.from_numpy(data["points"][number])), dict[Chosen, float]()

    def errors(choices: Sequence[Chosen]) -> list[float]:
        # The order of choice changes nothing but the random points on a prediction.
        ordered = list if trained.experiment.vision == "occluded" else sorted
        grasps = [tuple(ordered(order[list(choice)].tolist())) for choice in choices]
        new = list(dict.fromkeys(choice for choice in grasps if choice not in known))
        for part in in_batches(new, BATCH_SIZE):
            samples = [Sample(number, choice) for choice in part]
            for choice, mesh in zip(part, predict(trained, assemble, samples, data), strict=True):
                sampled = points_on(*mesh, points, data.objects[number])
                known[choice] = score(sampled, tree).chamfer
        return [known[choice] for choice in grasps]

    return errors
