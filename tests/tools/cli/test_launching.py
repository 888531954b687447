import json

from palpate.tools.chaos.fault_injection import Fault, InjectionLog, NodeRecovery
from palpate.tools.chaos.trials import Tally
from palpate.tools.cli.command_line import run


def test_a_kind_that_there_is_not_is_refused(capsys):
    assert run(["chaos", "--kinds", "kil"]) == 2
    text = capsys.readouterr().err
    assert text.startswith("palpate: --kinds kil: there is no 'kil'; ") and "kill" in text


def test_the_line_says_what_came_of_all_runs(monkeypatch, capsys):
    fault = Fault("kill", ("tracer",), "tracing", "/finger/goal", 3, 0.1)
    tally = Tally(5, runs=1, survived=1, failed=[(6, "gap: /a 1 of b is not there")], lost=1)
    back = [NodeRecovery("kill", "tracer", "tracing", seconds) for seconds in (0.75, 0.25, 0.5)]
    back.append(NodeRecovery("stop", "tracer", "tracing", 1.0))
    tally.injected.update(one.kind for one in InjectionLog([fault, fault]).faults)
    tally.back += back
    monkeypatch.setattr("palpate.tools.chaos.run_trials", lambda *_, **__: tally)
    assert run(["chaos"]) == 1
    text = capsys.readouterr()
    recovery = "recovery p50 0.50 s p99 0.75 s stopped p50 1.00 s p99 1.00 s"
    assert text.out == f"injected 2 survived 1 lost 1 duplicated 0 {recovery}\n"
    assert text.err == "palpate: chaos --seed 6 --minutes 0: gap: /a 1 of b is not there\n"
    run(["chaos", "--json"])
    assert json.loads(capsys.readouterr().out)["recovery_p99_s"] == 0.75
