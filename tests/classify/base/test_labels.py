"""Which labels can name a class."""

import pytest

from classify import InputError, LibraryError, TextureLibrary
from classify.methods import checked_label

REFUSED = (
    "unknown",
    "Unknown",
    " UNKNOWN ",
    "\uff55\uff4e\uff4b\uff4e\uff4f\uff57\uff4e",
    "a\nb",
    "a\x00",
    "\x1b[31moak",
    "\ud800",
    "a\u2028b",
)


@pytest.mark.parametrize("label", ["oak", "grün", "sand 2", "unknown oak", "未知"])
def test_a_printable_label_is_accepted(label: str) -> None:
    assert checked_label(label) == label


@pytest.mark.parametrize("label", REFUSED)
def test_a_label_that_cannot_name_a_class_is_refused(label: str, stationary) -> None:
    with pytest.raises(InputError, match="label ") as caught:
        checked_label(label)
    assert str(caught.value).isprintable()
    with pytest.raises(InputError, match="label "):
        TextureLibrary.train([(label, stationary("sand", side=64))])


@pytest.mark.parametrize("label", ["", "  "])
def test_a_blank_label_trains_no_class(label: str, stationary) -> None:
    with pytest.raises(LibraryError, match="has no label"):
        TextureLibrary.train([(label, stationary("malv", side=64))])
