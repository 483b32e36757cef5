"""The view of the schedule designer on the engineer page; the search is in `calstation.design`."""

from calstation.gui.engineer.designer.view import DesignView
