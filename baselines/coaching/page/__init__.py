"""The coach's page: a local server, one session a connection, recording with consent."""
