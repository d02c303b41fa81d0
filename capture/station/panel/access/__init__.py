"""Who may ask a panel: people with passwords, programs with tokens, roles, sessions."""
