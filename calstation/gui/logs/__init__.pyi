from .page import OfflinePage as OfflinePage
