"""The station as a service: systemd, the journal, backups."""
