"""The station as a service of the system: systemd, the journal, backups."""
