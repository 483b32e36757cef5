"""Cached code of compiled functions is discarded when the source of any of them changes."""

from pathlib import Path

from calstation.physics.kernels import discard_outdated


def test_cached_code_is_discarded_if_a_kernel_in_another_file_changes(tmp_path: Path) -> None:
    callee, index = tmp_path / "physics" / "a.py", tmp_path / "judgement" / "__pycache__" / "b.caller-1.nbi"
    for file, text in ((callee, "@kernel\ndef f(): return 1\n"), (index, "")):
        file.parent.mkdir(parents=True)
        file.write_text(text)

    def remains() -> bool:
        discard_outdated(tmp_path)
        return index.exists()

    assert not remains(), "code from before the first call has no known source"
    index.write_text("")
    assert remains()
    (callee.parent / "other.py").write_text("not compiled")
    assert remains()
    callee.write_text("@kernel\ndef f(): return 2\n")
    assert not remains()
