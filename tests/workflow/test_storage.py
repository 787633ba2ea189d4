"""Outputs in a bucket of S3: the arrays are those of a run on the disk. Needs moto and Snakemake's plugin."""

import numpy as np
import pytest

from palpate import store

pytest.importorskip("snakemake_storage_plugin_s3")
server = pytest.importorskip("moto.server")
boto3 = pytest.importorskip("boto3")


@pytest.fixture
def endpoint(monkeypatch):
    for name in ("AWS_ACCESS_KEY_ID", "AWS_SECRET_ACCESS_KEY"):
        monkeypatch.setenv(name, "local")
    monkeypatch.setenv("AWS_DEFAULT_REGION", "us-east-1")
    running = server.ThreadedMotoServer(port=0)
    running.start()
    yield "http://{}:{}".format(*running.get_host_and_port())
    running.stop()


def test_arrays_are_those_of_a_run_on_the_disk(finished, endpoint, tmp_path):
    bucket = boto3.resource("s3", endpoint_url=endpoint).create_bucket(Bucket="palpate")
    remote = finished.changed(results=str(tmp_path / "run"))
    storage = ["--default-storage-provider", "s3", "--default-storage-prefix", "s3://palpate/run"]
    storage += ["--storage-s3-endpoint-url", endpoint, "--local-storage-prefix", str(tmp_path / "copies")]
    result = remote("rejected", *storage, "--keep-storage-local-copies")
    assert result.returncode == 0, result.stderr
    fetched = tmp_path / "fetched"
    for each in bucket.objects.filter(Prefix="run/"):
        path = fetched / each.key.removeprefix("run/")
        path.parent.mkdir(parents=True, exist_ok=True)
        bucket.download_file(each.key, str(path))
    compared = set()
    for path in [*finished.run.glob("*/batch-*.zarr"), *finished.run.glob("*/batch-*.h5")]:
        mine, other = store.read(path), store.read(fetched / path.relative_to(finished.run))
        assert mine.keys() == other.keys()
        for name, values in mine.items():
            np.testing.assert_array_equal(other[name], values, err_msg=f"{path.name}: {name}")
        compared.add(path.parent.name)
    assert compared == {"surface", "grasps", "touch", "vision"}
