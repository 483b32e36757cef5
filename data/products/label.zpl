^XA
^FX Label 50 mm x 30 mm at 203 dpi. UTF-8. Fields: serial, product, station, operator, verdict, date, time, zone, attempt,
^FX software, run (its name), certificate (its number; empty unless issued),
^FX code (serial number and run, here as a QR code).
^CI28
^PW400
^LL240
^FO16,16^A0N,40,40^FD$serial^FS
^FO16,64^A0N,24,24^FD$product^FS
^FO16,92^A0N,24,24^FD$date^FS
^FO160,97^A0N,18,18^FD$zone^FS
^FO16,120^A0N,24,24^FD$station^FS
^FO16,150^A0N,44,44^FD$verdict^FS
^FO16,204^A0N,20,20^FDOperator $operator^FS
^FO272,96^BQN,2,3^FDMA,$code^FS
^XZ
