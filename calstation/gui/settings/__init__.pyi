from .page import StationPage as StationPage
