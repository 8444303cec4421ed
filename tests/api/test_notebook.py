"""The notebook runs from top to bottom, in a kernel of its own."""

import warnings
from pathlib import Path

import pytest

NOTEBOOK = Path(__file__).parents[2] / "docs/notebooks/first-image.ipynb"


def test_the_notebook_runs(tmp_path):
    client = pytest.importorskip("nbclient", reason="nbclient is not installed: pip install '.[dev]'")
    formats = pytest.importorskip("nbformat")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # those of Jupyter's own libraries
        notebook = formats.read(NOTEBOOK, as_version=4)
        resources = {"metadata": {"path": str(tmp_path)}}
        client.NotebookClient(notebook, timeout=120, resources=resources).execute()
    code = [cell for cell in notebook.cells if cell.cell_type == "code"]
    pictures = [out for cell in code for out in cell.outputs if "image/png" in out.get("data", {})]
    assert len(pictures) == 3
    assert "mm in the median" in code[-1].outputs[0]["text"]
    assert (tmp_path / "letters-volume.h5").exists()


def test_the_notebook_is_stored_without_results():
    formats = pytest.importorskip("nbformat", reason="nbformat is not installed: pip install '.[dev]'")
    code = [cell for cell in formats.read(NOTEBOOK, as_version=4).cells if cell.cell_type == "code"]
    assert code
    assert all(not cell.outputs and cell.execution_count is None for cell in code)
