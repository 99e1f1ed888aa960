delta3 up "$@" & p=$!
sleep 8

list() { for q in $(ps -eo pid,args | grep "[d]elta3\|[r]obot" | awk '{print $1}'); do [ -r /proc/$q/stat ] && echo "$q $(cat /proc/$q/comm) $(awk '{n=split($0,a,") "); split(a[2],b," "); print b[12]+b[13]}' /proc/$q/stat)"; done; }
list > /tmp/prof/a; sleep 5; list > /tmp/prof/b
join /tmp/prof/a /tmp/prof/b | awk '{d=($5-$3)/500; if (d>0.01) print $2,d; s+=d} END {print "sum",s}'
kill -INT $p; wait $p
