from tests.studies.timing import best_seconds


def test_the_best_of_some_rounds_counts():
    clock = iter([0.0, 3.0, 10.0, 11.0, 20.0, 22.0])
    assert best_seconds(lambda: None, 3, lambda: next(clock)) == 1.0
