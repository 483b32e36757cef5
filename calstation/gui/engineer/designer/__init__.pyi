from .view import DesignView as DesignView
