"""The EthernetKRL channel: documents, commands and their replies, tables, refusals with their cures."""
