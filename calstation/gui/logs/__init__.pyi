from .exports import Exports as Exports
from .page import OfflinePage as OfflinePage
from .source_bar import SourceBar as SourceBar
from .source_bar import ask_log as ask_log
