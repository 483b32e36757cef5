"""The view of the schedule designer on the engineer page; `calstation.designer` contains the search."""

from calstation.gui.engineer.designer.view import DesignView
