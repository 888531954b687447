from __future__ import annotations

import pytest

from palpate.bench.table import named
from tests.studies.__main__ import STUDIES, main


@pytest.mark.parametrize("name", STUDIES)
def test_every_study_is_where_its_name_says(name):
    assert all(callable(named(f"tests.studies.{place}")) for place in STUDIES[name].values())


def test_a_study_that_there_is_not_is_refused(capsys):
    with pytest.raises(SystemExit, match="2"):
        main(["whale"])
    assert "there is no study 'whale'; there are shapes, casts," in capsys.readouterr().err
