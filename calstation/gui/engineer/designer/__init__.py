"""The schedule designer on the engineer page: goal of the search, result with plots, and saving.

The search is in `calstation.design`.
"""

from calstation.gui.engineer.designer.view import DesignView
