from .page import EngineerPage as EngineerPage
