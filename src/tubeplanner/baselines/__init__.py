"""The schemes that tubes are compared with: lines, bang-bang, arcs, joint lines."""
