"""The list of libraries names their licences."""

from importlib.metadata import distribution

from calstation.gui.help.about import _licence_name


def test_library_whose_metadata_contain_the_whole_licence_is_listed_with_its_title() -> None:
    assert _licence_name(distribution("allantools")) == "GNU LESSER GENERAL PUBLIC LICENSE"
