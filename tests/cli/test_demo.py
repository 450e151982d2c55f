"""The demo holds on this machine, and would say so if it did not."""

import pytest

from curvcasadi.cli import demo


def test_demo_holds_and_draws_two_figures(tmp_path, capsys):
    assert demo.run(tmp_path) == 0
    printed = capsys.readouterr().out
    assert "FAILED" not in printed
    assert len(list(tmp_path.glob("*.png"))) == 2


def test_demo_tells_a_wrong_value(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(demo, "TIP", (0.0, 14.3, -6.0))
    monkeypatch.setattr(demo, "_ode_tip", lambda beam, q: [0.0, 0.0, 0.0])
    assert demo.run(tmp_path) == 1
    assert "FAILED" in capsys.readouterr().out


def test_a_missing_compiler_is_named(tmp_path, monkeypatch):
    monkeypatch.setenv("PATH", "")
    with pytest.raises(FileNotFoundError, match="gcc"):
        demo.run(tmp_path)
