"""Message ids, states and faults as sentences in the language in force; the engine itself knows no sentences."""
