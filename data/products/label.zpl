^XA
^FX Label 50 mm x 30 mm at 203 dpi. UTF-8. Fields: serial, product, station, operator, verdict, date, time, attempt, software.
^CI28
^PW400
^LL240
^FO16,16^A0N,40,40^FD$serial^FS
^FO16,64^A0N,24,24^FD$product^FS
^FO16,96^A0N,24,24^FD$date  $station^FS
^FO16,128^A0N,44,44^FD$verdict^FS
^FO16,184^A0N,20,20^FDOperator $operator^FS
^FO284,112^BQN,2,4^FDQA,$serial^FS
^XZ
