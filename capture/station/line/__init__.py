"""The station on the line: handshake with a PLC over Modbus TCP, results by MQTT."""
