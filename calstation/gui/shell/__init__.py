"""The main window and what all pages share: application context, engine link, run status and role."""
