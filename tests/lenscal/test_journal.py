import pytest

from lenscal.errors import FileError
from lenscal.journal import JournalWriter, read_journal


def test_a_journal_is_gone_on_with_after_a_torn_line(tmp_path):
    path = tmp_path / "journal.jsonl"
    with JournalWriter(path) as journal:
        journal.append({"a": 1})
        journal.append({"a": 2})
    with open(path, "ab") as file:
        file.write(b'1234abcd {"number":2,"a"')
    with JournalWriter(path, resume=True) as journal:
        journal.append({"a": 3})
    assert [(e["number"], e["a"]) for e in read_journal(path)] == [(0, 1), (1, 2), (2, 3)]


def test_a_journal_that_is_not_there_cannot_be_gone_on_with(tmp_path):
    with pytest.raises(FileError, match="cannot go on with the journal .*: No such file"):
        JournalWriter(tmp_path / "none.jsonl", resume=True)


def test_one_writer_at_a_time(tmp_path):
    path = tmp_path / "journal.jsonl"
    with JournalWriter(path), pytest.raises(FileError, match="another program is writing to it"):
        JournalWriter(path, resume=True)
