from .page import QualityPage as QualityPage
